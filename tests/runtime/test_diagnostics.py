"""The rows of ``scenegate doctor``: when each is ok, a note or an error, and the remedy that it names."""

import errno
import os
import resource
import socket
from pathlib import Path
from typing import Any, NoReturn

import pytest

from gateway.runtime import diagnostics
from gateway.runtime.diagnostics import findings
from gateway.runtime.installation import Finding, Verdict
from gateway.runtime.workers import process_tuning
from renderers.compiler import cache_folder

PARTS = ("needed", "background")


def finding(subject: str, http_port: int | None = None) -> Finding:
    """Return one row."""
    ports = {"--http-port": ("HTTP", http_port)} if http_port is not None else {}
    return next(row for row in findings("127.0.0.1", ports) if row.subject == subject)


def is_note(row: Finding, detail: str, remedy: str, verdict: Verdict = Verdict.NOTE) -> None:
    """The row says what was found, what that means and what to do."""
    assert row.verdict is verdict
    assert row.detail.startswith(detail)
    assert row.meaning.endswith(".")
    assert row.remedy.startswith(remedy)


@pytest.mark.parametrize(
    ("limit", "verdict"), [((4 << 30) - 1, Verdict.NOTE), (4 << 30, Verdict.OK), (resource.RLIM_INFINITY, Verdict.OK)]
)
def test_little_address_space_is_a_note(monkeypatch: pytest.MonkeyPatch, limit: int, verdict: Verdict) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda which: (limit, resource.RLIM_INFINITY))
    row = finding("address space")
    assert row.verdict is verdict
    if verdict is Verdict.NOTE:
        is_note(row, "limited to 4095 MB", "ulimit -v unlimited")


@pytest.mark.parametrize(
    ("listed", "verdict", "detail"),
    [
        ((), Verdict.NOTE, "not compiled yet, in "),
        (("needed",), Verdict.NOTE, "not compiled yet: background, in "),
        (PARTS, Verdict.OK, "0 compiled, in "),
    ],
)
def test_kernels_are_complete_when_every_part_is_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listed: tuple[str, ...], verdict: Verdict, detail: str
) -> None:
    monkeypatch.setattr("gateway.runtime.kernels.parts.PARTS", PARTS)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    cache_folder.root.cache_clear()
    try:
        if listed:
            cache_folder.folder().mkdir()
            cache_folder.write_manifest({part: [] for part in listed})
        row = finding("kernels")
    finally:
        cache_folder.root.cache_clear()
    assert row.verdict is verdict
    assert row.detail.startswith(detail)
    assert str(tmp_path) in row.detail
    if verdict is Verdict.NOTE:
        is_note(row, detail, "scenegate warmup")


@pytest.mark.parametrize(
    ("variable", "verdict", "detail"),
    [
        ("NUMBA_CACHE_DIR", Verdict.ERROR, "not compiled yet, in /proc/kernels/"),
        ("SCENEGATE_CACHE_DIR", Verdict.NOTE, "not compiled yet, and the cache folder cannot be written or is full"),
    ],
)
def test_a_cache_folder_that_cannot_be_written_is_found(
    monkeypatch: pytest.MonkeyPatch, variable: str, verdict: Verdict, detail: str
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")  # configure() writes it; monkeypatch takes it back
    monkeypatch.setenv(variable, "/proc/kernels")
    cache_folder.root.cache_clear()
    try:
        is_note(finding("kernels"), detail, f"{variable}=FOLDER", verdict)
    finally:
        cache_folder.root.cache_clear()


def test_a_free_port_is_ok_and_one_that_is_not_allowed_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    assert finding("port 0", 0) == Finding("port 0", Verdict.OK, "HTTP: free")

    def refuse(host: str, port: int) -> NoReturn:
        raise OSError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(process_tuning, "listen", refuse)
    monkeypatch.setattr(diagnostics, "probe_instance", lambda host, port: pytest.fail("nothing listens there"))
    detail = "HTTP: permission denied (127.0.0.1 port 80)"
    is_note(finding("port 80", 80), detail, "--http-port PORT, above 1023", Verdict.ERROR)


def test_a_loopback_interface_that_is_down_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    assert finding("loopback").verdict is Verdict.OK

    def unreachable(*_: object) -> NoReturn:
        raise OSError(errno.ENETUNREACH, os.strerror(errno.ENETUNREACH))

    monkeypatch.setattr(socket, "create_connection", unreachable)
    row = diagnostics._check_loopback()  # noqa: SLF001 - the ports' rows use connections, too
    is_note(row, "127.0.0.1: Network is unreachable", "ip link set lo up", Verdict.ERROR)


def test_no_route_for_multicast_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    class Unreachable(socket.socket):
        def connect(self, address: Any) -> NoReturn:
            raise OSError(errno.ENETUNREACH, os.strerror(errno.ENETUNREACH))

    monkeypatch.setattr(socket, "socket", Unreachable)
    row = diagnostics._check_multicast()  # noqa: SLF001 - the ports' rows use sockets, too
    is_note(row, "no route, Network is unreachable", "sudo ip link set lo multicast on;")
