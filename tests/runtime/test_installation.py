"""What ``scenegate doctor`` finds in broken installations."""

import subprocess
from importlib.metadata import PackageNotFoundError
from typing import Any

import pytest

from gateway.runtime import installation
from gateway.runtime.installation import Finding, Verdict, installation_findings


def check(monkeypatch: pytest.MonkeyPatch, output: str) -> list[Finding]:
    """Return the findings about libraries if ``pip check`` prints this."""

    def run(command: tuple[str, ...], **_: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, int(bool(output)), output, "")

    monkeypatch.setattr(subprocess, "run", run)
    return [each for each in installation_findings() if each.subject == "libraries"]


def test_this_installation_is_checked_by_pip() -> None:
    (row,) = [each for each in installation_findings() if each.subject == "libraries"]
    assert row.verdict is Verdict.OK


def test_conflicts_of_our_distributions_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = check(
        monkeypatch,
        "scenegate 0.1.0 requires isal, which is not installed.\n"
        "scenegate-client 0.1.0 has requirement numpy>=1.24, but you have numpy 1.20.0.\n"
        "other 1.0 requires thing, which is not installed.\n",
    )
    assert [row.verdict for row in rows] == [Verdict.ERROR, Verdict.ERROR]
    assert ["isal" in rows[0].detail, "numpy 1.20.0" in rows[1].detail] == [True, True]
    assert [row.verdict for row in check(monkeypatch, "")] == [Verdict.OK]


def test_an_environment_without_pip_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_pip(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(installation, "version", no_pip)
    (row,) = [each for each in installation_findings() if each.subject == "libraries"]
    assert row.verdict is Verdict.NOTE
