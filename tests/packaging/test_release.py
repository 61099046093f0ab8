"""``make release`` in a clone: tag, texts, generated pages, and the tests that a release could break."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.waiting import SECONDS
from tools import release
from tools.release import ReleaseError, check_version

ROOT = Path(__file__).parents[2]
UNTRUE_AFTERWARDS = re.compile(r"not on the package index|not released|will contain|not published yet", re.IGNORECASE)


def run(clone: Path, *command: str, expect: int = 0) -> str:
    """Run a command in the clone, with the clone's packages; return its output."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    environment |= {"PYTHONPATH": str(clone), "GIT_CONFIG_GLOBAL": os.devnull, "GIT_CONFIG_NOSYSTEM": "1"}
    for role in ("AUTHOR", "COMMITTER"):
        environment |= {f"GIT_{role}_NAME": "Tester", f"GIT_{role}_EMAIL": "tester@example.org"}
    ran = subprocess.run(
        command, cwd=clone, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False
    )
    assert ran.returncode == expect, ran.stdout[-4000:] + ran.stderr[-4000:]
    return ran.stdout.strip() + ran.stderr.strip()


def make_release(clone: Path, version: str, expect: int = 0) -> str:
    return run(
        clone,
        "make",
        "--no-print-directory",
        "release",
        f"VERSION={version}",
        f"PYTHON={sys.executable}",
        expect=expect,
    )


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A clone of the last commit, with what is not committed yet."""
    folder = tmp_path / "clone"
    if not (ROOT / ".git").exists():
        pytest.skip("this is not a checkout")
    run(ROOT, "git", "clone", "--quiet", str(ROOT), str(folder))
    changes = subprocess.run(["git", "diff", "--binary", "HEAD"], cwd=ROOT, capture_output=True, check=True).stdout
    if changes:
        subprocess.run(["git", "apply", "-"], cwd=folder, input=changes, check=True)
        run(folder, "git", "commit", "--quiet", "--all", "--message", "Changes")
    return folder


@pytest.mark.slow
def test_releases_in_a_clone(clone: Path) -> None:
    first = release.read_version(clone)
    make_release(clone, first)
    assert run(clone, "git", "status", "--porcelain") == ""
    assert run(clone, "git", "describe") == f"v{first}"
    assert run(clone, "git", "cat-file", "-t", f"v{first}") == "tag"
    for page in ("README.md", "CHANGELOG.md", "docs/README.md", "CONTRIBUTING.md"):
        assert UNTRUE_AFTERWARDS.findall((clone / page).read_text()) == [], page
    assert "pip install scenegate" in (clone / "README.md").read_text()
    run(clone, sys.executable, "-m", "tools.docs_pages", "docs")
    assert run(clone, "git", "status", "--porcelain") == "", "generated pages have changed"
    tests = ("tests/packaging/test_release_files.py", "tests/docs/test_pages.py")
    run(clone, sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *tests, "-m", "not slow")

    assert "is not higher" in make_release(clone, first, expect=2)
    second = f"{first.rpartition('.')[0]}.{int(first.rpartition('.')[2]) + 1}"
    (clone / "README.md").write_text("changed")
    assert "not committed" in make_release(clone, second, expect=2)
    run(clone, "git", "checkout", "--quiet", "README.md")
    make_release(clone, second)
    assert run(clone, "git", "describe") == f"v{second}"
    headings = re.findall(r"^## \[(.*?)\]", (clone / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert headings == ["Unreleased", second, first]
    assert f"<version>{second}</version>" in (clone / "deploy/ros2/scenegate_ros2/package.xml").read_text()
    assert f'version="{second}"' in (clone / "deploy/ros2/scenegate_ros2/setup.py").read_text()


@pytest.mark.parametrize("version", ["", "1", "1.2", "v1.2.3", "1.2.3rc1", "1.2.3\n"])
def test_other_texts_are_no_versions(version: str) -> None:
    with pytest.raises(ReleaseError, match="is not a version"):
        check_version(version, "0.1.0", [])


def test_the_first_release_is_not_lower_than_the_checkout() -> None:
    check_version("0.1.0", "0.1.0", [])
    with pytest.raises(ReleaseError, match=r"0.0.9 .*0.1.0"):
        check_version("0.0.9", "0.1.0", [])


@pytest.mark.parametrize(
    ("version", "allowed"), [("0.10.0", True), ("0.9.1", True), ("0.9.0", False), ("0.2.0", False)]
)
def test_versions_only_rise(version: str, allowed: bool) -> None:
    try:
        check_version(version, "0.9.0", ["0.9.0", "0.1.0"])
        accepted = True
    except ReleaseError:
        accepted = False
    assert accepted == allowed


def test_texts_that_the_first_release_replaces_are_there() -> None:
    if release.released_versions(ROOT):
        pytest.skip("it has been made")
    for name, texts in release.FIRST_RELEASE.items():
        content = (ROOT / name).read_text()
        assert [before for before in texts if content.count(before) != 1] == []
