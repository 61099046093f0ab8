"""``make release VERSION=1.2.3``: writes the version into all files that state it, commits and tags.

Standard library only, so that it runs before any environment is made.
"""

import datetime
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]
_NUMBER: Final = r"\d+\.\d+\.\d+"

FIRST_RELEASE: Final = {
    "README.md": {
        "`pip install ./client .`": "`pip install scenegate`",
        "`pip install ./client` is": "`pip install scenegate-client` is",
        "`pip install './client[camera]'` is": "`pip install 'scenegate-client[camera]'` is",
        " Scenegate is not on the package index yet.": "",
        "Not released yet; the [changelog]": "The [changelog]",
    },
    "docs/README.md": {"pip install ./client . ": "pip install scenegate   "},
}
"""Replacements, by file, of texts that are true only before the first release."""


class ReleaseError(Exception):
    """The release cannot be made; the message is one sentence."""


def release(version: str, root: Path = ROOT) -> None:
    """Commit and tag a version.

    Raises:
        ReleaseError: The version is not a new one, or there are changes that are not committed.
    """
    released = released_versions(root)
    check_version(version, read_version(root), released)
    if git(root, "status", "--porcelain"):
        raise ReleaseError("There are changes that are not committed.")
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    replace(root / "client/scenegate/__init__.py", rf'(__version__: Final = )"{_NUMBER}"', rf'\g<1>"{version}"')
    replace(root / "pyproject.toml", rf"(scenegate-client\[.*\]==){_NUMBER}", rf"\g<1>{version}")
    ros2 = root / "deploy/ros2/scenegate_ros2"
    replace(ros2 / "package.xml", rf"(<version>){_NUMBER}<", rf"\g<1>{version}<")
    replace(ros2 / "setup.py", rf'(version=)"{_NUMBER}"', rf'\g<1>"{version}"')
    replace(root / "CHANGELOG.md", r"^## \[Unreleased\]\n", rf"\g<0>\n## [{version}] - {today}\n")
    if not released:
        for name, texts in FIRST_RELEASE.items():
            for before, after in texts.items():
                replace(root / name, re.escape(before), after)
    git(root, "commit", "--quiet", "--all", "--message", f"Release {version}")
    git(root, "tag", "--annotate", f"v{version}", "--message", f"Scenegate {version}")


def read_version(root: Path = ROOT) -> str:
    """Return the version of a checkout."""
    match = re.search(rf'__version__: Final = "({_NUMBER})"', (root / "client/scenegate/__init__.py").read_text())
    assert match is not None
    return match[1]


def released_versions(root: Path = ROOT) -> list[str]:
    """Return the versions that the changelog lists."""
    return re.findall(rf"^## \[({_NUMBER})\]", (root / "CHANGELOG.md").read_text(), re.MULTILINE)


def check_version(version: str, current: str, released: list[str]) -> None:
    """Raise ``ReleaseError`` unless the version is one to release after others.

    Args:
        current: Version of the checkout. The first release may have it.
        released: Versions that the changelog lists, all of which are lower.
    """
    if not re.fullmatch(_NUMBER, version):
        raise ReleaseError(f"make release VERSION=1.2.3: {version!r} is not a version.")
    newest = max(released, key=_key, default="0.0.0")
    if _key(version) <= _key(newest):
        raise ReleaseError(f"{version} is not higher than {newest}, which CHANGELOG.md lists.")
    if _key(version) < _key(current):
        raise ReleaseError(f"{version} is lower than {current}, the version of this checkout.")


def _key(version: str) -> tuple[int, ...]:
    return tuple(map(int, version.split(".")))


def replace(path: Path, pattern: str, replacement: str) -> None:
    """Replace the first match in a file.

    Raises:
        ReleaseError: Nothing matches.
    """
    text, count = re.subn(pattern, replacement, path.read_text(), count=1, flags=re.MULTILINE)
    if not count:
        raise ReleaseError(f"{path.name} has no {pattern!r}, which the release replaces.")
    path.write_text(text)


def git(root: Path, *arguments: str) -> str:
    """Run git and return its output."""
    ran = subprocess.run(["git", *arguments], cwd=root, capture_output=True, text=True, check=False)
    if ran.returncode:
        raise ReleaseError(f"git {arguments[0]}: {ran.stderr.strip() or ran.stdout.strip()}")
    return ran.stdout.strip()


if __name__ == "__main__":
    try:
        release(sys.argv[1] if len(sys.argv) > 1 else "")
    except ReleaseError as error:
        sys.exit(str(error))
    sys.stdout.write(f"Now: git push origin HEAD v{sys.argv[1]}\n")
    if not re.search(r"^Repository = ", (ROOT / "pyproject.toml").read_text(), re.MULTILINE):
        sys.stdout.write("Before that, set what CONTRIBUTING.md lists under Release.\n")
