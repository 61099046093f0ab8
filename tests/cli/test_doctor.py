"""The table of ``scenegate doctor``, and when its exit code is an error."""

import sys
from collections.abc import Iterator, Mapping

import pytest

from gateway.cli import doctor
from gateway.runtime import diagnostics
from gateway.runtime.installation import Finding, Verdict

OK = Finding("an ok row", Verdict.OK, "fine")
NOTE = Finding("a note", Verdict.NOTE, "a [strange] thing", "Something is slow.", "do this")
ERROR = Finding("an error", Verdict.ERROR, "broken", "Nothing works.", "do that")
Ports = Mapping[str, tuple[str, int]]


@pytest.mark.parametrize(
    ("rows", "good", "summary"),
    [
        ((OK, NOTE), True, "0 errors, 1 note."),
        ((ERROR,), False, "1 error, 0 notes."),
        ((OK, ERROR, NOTE), False, "1 error, 1 note."),
        ((), True, "0 errors, 0 notes."),
    ],
)
def test_each_finding_is_shown_with_its_meaning_and_remedy(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    rows: tuple[Finding, ...],
    good: bool,
    summary: str,
) -> None:
    asked: list[tuple[str, Ports]] = []

    def findings(host: str, ports: Ports) -> Iterator[Finding]:
        asked.append((host, ports))
        yield from rows

    monkeypatch.setattr(doctor, "installation_findings", lambda: iter(()))
    monkeypatch.setattr(diagnostics, "findings", findings)
    for name, value in (("HTTP_PORT", "1"), ("GRPC_PORT", "2"), ("TCPQ_PORT", "off")):
        monkeypatch.setenv(f"SCENEGATE_{name}", value)
    assert doctor.print_findings() == good
    assert asked == [("127.0.0.1", {"--http-port": ("HTTP", 1), "--grpc-port": ("gRPC", 2)})]
    lines = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    assert lines[-1] == summary
    for row in rows:
        at = next(number for number, line in enumerate(lines) if line.startswith(row.subject))
        assert row.verdict.value in lines[at]
        assert lines[at].endswith(row.detail)
        if row.meaning:
            assert lines[at + 1].strip() == row.meaning
            assert lines[at + 2].strip() == f"To do: {row.remedy}"


def test_the_environment_is_checked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(doctor, "installation_findings", lambda: iter(()))
    monkeypatch.setattr(diagnostics, "findings", lambda *arguments: iter((OK,)))
    monkeypatch.setenv("SCENEGATE_HTPT_PORT", "1")
    monkeypatch.setenv("SCENEGATE_QUEUE", "many")
    rows = {row.subject: row for row in doctor.all_findings()}
    assert rows["environment"].verdict is Verdict.NOTE
    assert rows["environment"].detail == "SCENEGATE_HTPT_PORT is not a setting; did you mean SCENEGATE_HTTP_PORT?"
    assert rows["settings"].verdict is Verdict.ERROR
    assert rows["settings"].detail.startswith("SCENEGATE_QUEUE: input should be a valid integer")
    assert OK.subject in rows


def test_libraries_that_do_not_work_are_findings(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "installation_findings", lambda: iter((ERROR,)))
    monkeypatch.setitem(sys.modules, "rich.table", None)
    monkeypatch.setitem(sys.modules, "gateway.runtime.diagnostics", None)
    assert not doctor.print_findings()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "an error: error: broken"
    assert "this machine: error: not checked: ModuleNotFoundError" in "\n".join(lines)
    assert lines[-1] == "2 errors, 0 notes."
