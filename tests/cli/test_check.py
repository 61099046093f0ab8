"""The table of ``scenegate check``, and when its exit code is an error."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping

import pytest

from gateway.cli import check
from gateway.runtime.diagnostics import Finding, Verdict
from gateway.wiring import warmup

OK, NOTE, BAD = (Finding(f"a {verdict.value} row", verdict, "detail") for verdict in Verdict)


@pytest.mark.parametrize(
    ("rows", "good"),
    [((OK, NOTE), True), ((BAD,), False), ((BAD, OK), False), ((OK, BAD, NOTE), False), ((), True)],
)
def test_any_error_makes_the_check_fail(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], rows: tuple[Finding, ...], good: bool
) -> None:
    asked: list[tuple[str, Mapping[str, int], int, Collection[str]]] = []

    def findings(host: str, ports: Mapping[str, int], threads: int, parts: Collection[str]) -> Iterator[Finding]:
        asked.append((host, ports, threads, parts))
        yield from rows

    monkeypatch.setattr(check, "findings", findings)
    for name, value in (("HTTP_PORT", "1"), ("GRPC_PORT", "2"), ("TCPQ_PORT", "off"), ("THREADS", "5")):
        monkeypatch.setenv(f"SCENEGATE_{name}", value)
    assert check.print_findings() == good
    assert asked == [("127.0.0.1", {"HTTP": 1, "gRPC": 2}, 5, warmup.PARTS)]
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("  ")[0].strip() for line in lines[1:]] == [row.subject for row in rows]
