"""What ``scenegate doctor`` finds in broken installations, made of small distributions in a folder."""

from __future__ import annotations

import base64
import hashlib
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

import gateway
from gateway.runtime import installation
from gateway.runtime.installation import Finding, Verdict, installation_findings

HOME = Path(gateway.__file__).resolve().parents[1]


class Site:
    """A folder of distributions that is searched before all others."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def add(self, name: str, version: str, files: Mapping[str, str], requires: tuple[str, ...] = ()) -> None:
        """Install a distribution."""
        described = self.folder / f"{name.replace('-', '_')}-{version}.dist-info"
        described.mkdir()
        lines = ["Metadata-Version: 2.1", f"Name: {name}", f"Version: {version}"]
        (described / "METADATA").write_text("\n".join([*lines, *(f"Requires-Dist: {each}" for each in requires), ""]))
        records = []
        for path, content in files.items():
            target = self.folder / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(content)
            digest = base64.urlsafe_b64encode(hashlib.sha256(content.encode()).digest()).rstrip(b"=").decode()
            records.append(f"{path},sha256={digest},{len(content)}")
        (described / "RECORD").write_text("\n".join(records))

    def findings(self, subject: str) -> list[Finding]:
        return [each for each in installation_findings() if each.subject == subject]


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Site:
    """Scenegate, which needs one library."""
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(installation, "IMPORTS", {"My-Library": "my_library.use"})
    monkeypatch.delitem(sys.modules, "my_library", raising=False)
    site = Site(tmp_path)
    site.add("scenegate", "0.1.0", {}, ("my_library<3,>=2.1", "other; extra == 'more'"))
    return site


def only(found: list[Finding]) -> Finding:
    (row,) = found
    return row


def test_a_library_within_the_limits(site: Site) -> None:
    site.add("my_library", "2.1.0", {"my_library/__init__.py": "use = 1"})
    assert only(site.findings("my_library")) == Finding("my_library", Verdict.OK, "2.1.0")


def test_extras_that_are_not_installed_are_not_missed(site: Site) -> None:
    assert site.findings("other") == []


@pytest.mark.parametrize("version", ["2.0.9", "3", "3.0.0rc1"])
def test_a_library_outside_the_limits(site: Site, version: str) -> None:
    site.add("my_library", version, {"my_library/__init__.py": "use = 1"})
    row = only(site.findings("my_library"))
    assert row.verdict is Verdict.ERROR
    assert row.detail == f"{version}, but Scenegate needs <3,>=2.1"
    assert row.remedy == "pip install 'my_library<3,>=2.1'"


def test_a_missing_library(site: Site) -> None:
    row = only(site.findings("my_library"))
    assert (row.verdict, row.detail) == (Verdict.ERROR, "not installed")


@pytest.mark.parametrize(
    ("content", "fault"),
    [
        ("raise RuntimeError('the wrong ABI')", "RuntimeError: the wrong ABI"),
        ("", "AttributeError: module 'my_library' has no attribute 'use'"),
    ],
)
def test_a_library_that_cannot_be_used(site: Site, content: str, fault: str) -> None:
    """Its metadata is as it should be."""
    site.add("my_library", "2.1", {"my_library/__init__.py": content})
    row = only(site.findings("my_library"))
    assert row.verdict is Verdict.ERROR
    assert row.detail == f"2.1 cannot be used: {fault}"
    assert "--force-reinstall" in row.remedy


def test_a_library_whose_files_a_twin_has_removed(site: Site) -> None:
    site.add("my_library", "2.1", {"my_library/__init__.py": "use = 1"})
    (site.folder / "my_library/__init__.py").unlink()
    row = only(site.findings("my_library"))
    assert row.verdict is Verdict.ERROR
    assert row.detail.startswith("2.1 cannot be used: AttributeError")  # an empty folder counts as a package


def test_a_twin(site: Site) -> None:
    site.add("my_library", "2.1", {"my_library/__init__.py": "use = 1"})
    site.add("my-twin", "5", {"my_library/__init__.py": "use = 1"})
    row = only(site.findings("my_library"))
    assert (row.verdict, row.detail) == (Verdict.NOTE, "2.1, beside my-twin")


def test_a_library_of_another_distribution(site: Site) -> None:
    site.add("my-twin", "5", {"my_library/__init__.py": "use = 1"})
    row = only(site.findings("my_library"))
    assert (row.verdict, row.detail) == (Verdict.NOTE, "provided by my-twin")


def test_another_package_of_our_name_is_imported(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    site.add("other-renderers", "1", {"renderers/__init__.py": ""})
    for name in [name for name in sys.modules if name.partition(".")[0] == "renderers"]:
        monkeypatch.delitem(sys.modules, name)
    row = only(site.findings("renderers"))
    assert row.verdict is Verdict.ERROR
    theirs = site.folder / "renderers"
    assert row.detail == f"{theirs} (of other-renderers) is imported instead of {HOME / 'renderers'}"


def test_a_distribution_with_a_package_of_our_name_is_named(site: Site) -> None:
    """Its files are in the folder of ours; they have not replaced any."""
    site.add("other-renderers", "1", {"renderers/of_the_other.py": ""})
    shutil.rmtree(site.folder / "renderers")
    row = only(site.findings("renderers"))
    assert (row.verdict, row.detail) == (Verdict.NOTE, "other-renderers has a package of this name, too")


@pytest.mark.parametrize(("version", "verdict"), [("0.1.0", Verdict.OK), ("0.2.0", Verdict.ERROR)])
def test_a_library_of_exactly_one_version(
    site: Site, monkeypatch: pytest.MonkeyPatch, version: str, verdict: Verdict
) -> None:
    monkeypatch.setattr(installation, "IMPORTS", {"my-client": "my_library.use"})
    site.add("my-client", version, {"my_library/__init__.py": "use = 1"})
    (site.folder / "scenegate-0.1.0.dist-info/METADATA").write_text(
        "Metadata-Version: 2.1\nName: scenegate\nVersion: 0.1.0\nRequires-Dist: my-client[camera]==0.1.0\n"
    )
    assert only(site.findings("my-client")).verdict is verdict


@pytest.mark.parametrize("name", ["gateway.py", "renderers"])
def test_something_of_our_name_lies_in_the_current_folder(
    site: Site, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    folder = tmp_path_factory.mktemp("work")
    (folder / name).touch()
    monkeypatch.chdir(folder)
    row = only(site.findings(name.removesuffix(".py")))
    assert row.verdict is Verdict.NOTE
    assert row.detail == f"{folder / name} has the name of our package"


def test_files_that_another_distribution_has_replaced(site: Site) -> None:
    """It was installed into the same folder, after ours."""
    described = site.folder / "scenegate-0.1.0.dist-info"
    (described / "RECORD").write_text("gateway/a.py,sha256=AAAA,1\nother/b.py,sha256=AAAA,1\ngateway/c.pyc,,\n")
    (site.folder / "gateway").mkdir()
    (site.folder / "gateway/a.py").touch()
    site.add("other", "1", {"gateway/a.py": ""})
    rows = site.findings("scenegate")
    assert [row.verdict for row in rows] == [Verdict.OK, Verdict.ERROR]
    assert rows[1].detail.endswith("missing or changed: gateway/a.py; other has a package of that name")


def test_protobuf_that_is_older_than_the_generated_code(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    site.add("messages", "1", {"old_messages.py": "raise ValueError('gencode 7.35.1 runtime 6.33.6')"})
    monkeypatch.setattr(installation, "_GENERATED", "old_messages")
    row = only(site.findings("messages"))
    assert (row.verdict, row.detail) == (Verdict.ERROR, "ValueError: gencode 7.35.1 runtime 6.33.6")


def test_every_required_library_is_imported() -> None:
    """This environment is as it should be."""
    rows = [row for row in installation_findings() if row.verdict is not Verdict.OK]
    assert rows == []
