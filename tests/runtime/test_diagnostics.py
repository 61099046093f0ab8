"""The rows of ``scenegate check``: when each is ok, a note or an error, and the remedy that it names."""

from __future__ import annotations

import ctypes
import errno
import os
import resource
import socket
from pathlib import Path
from typing import Any, NoReturn

import pytest

from gateway import __version__
from gateway.runtime import diagnostics, process_tuning
from gateway.runtime.diagnostics import Finding, Verdict, findings
from renderers.compiler import cache_folder

PARTS = ("needed", "background")


def finding(subject: str, **ports: int) -> Finding:
    """Return one row."""
    return next(row for row in findings("127.0.0.1", ports, 3, PARTS) if row.subject == subject)


def test_version_and_threads_are_shown() -> None:
    assert finding("scenegate") == Finding("scenegate", Verdict.OK, __version__)
    assert finding("threads") == Finding("threads", Verdict.OK, "3 threads render")


def test_a_library_that_is_not_installed_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(diagnostics, "LIBRARIES", ("numpy", "no-such-library"))
    assert finding("numpy").verdict is Verdict.OK
    assert finding("no-such-library") == Finding("no-such-library", Verdict.BAD, "not installed")


def test_a_missing_glib_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(name: str) -> NoReturn:
        raise OSError(name)

    monkeypatch.setattr(ctypes, "CDLL", fail)
    row = finding("glib")
    assert row.verdict is Verdict.NOTE
    assert row.detail.endswith("apt install libglib2.0-0")


@pytest.mark.parametrize(
    ("hard", "verdict"),
    [(4095, Verdict.NOTE), (4096, Verdict.OK), (resource.RLIM_INFINITY, Verdict.OK)],
)
def test_few_open_files_are_a_note(monkeypatch: pytest.MonkeyPatch, hard: int, verdict: Verdict) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda which: (256, hard))
    assert finding("open files") == Finding("open files", verdict, f"256 now, up to {hard}")


@pytest.mark.parametrize(
    ("listed", "verdict", "detail"),
    [
        ((), Verdict.NOTE, "not compiled yet; the next start compiles them: scenegate warmup"),
        (("needed",), Verdict.NOTE, "not compiled yet: background; the next start"),
        (PARTS, Verdict.OK, "0 compiled, in "),
    ],
)
def test_kernels_are_complete_when_every_part_is_listed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, listed: tuple[str, ...], verdict: Verdict, detail: str
) -> None:
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


def test_a_free_port_is_ok_and_one_that_is_not_allowed_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    assert finding("port 0", HTTP=0) == Finding("port 0", Verdict.OK, "HTTP: free")

    def refuse(host: str, port: int) -> NoReturn:
        raise OSError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(process_tuning, "listen", refuse)
    monkeypatch.setattr(diagnostics, "probe_instance", lambda host, port: pytest.fail("nothing listens there"))
    assert finding("port 80", HTTP=80) == Finding("port 80", Verdict.BAD, "HTTP: not allowed to (127.0.0.1 port 80)")


def test_no_route_for_multicast_is_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    class Unreachable(socket.socket):
        def connect(self, address: Any) -> NoReturn:
            raise OSError(errno.ENETUNREACH, os.strerror(errno.ENETUNREACH))

    monkeypatch.setattr(socket, "socket", Unreachable)
    row = diagnostics._multicast()  # noqa: SLF001 - the ports' rows use sockets, too
    assert row.verdict is Verdict.NOTE
    assert row.detail.startswith("no route, Network is unreachable, for LCM: sudo ip link set lo multicast on;")


@pytest.mark.parametrize(
    ("limit", "verdict"), [("3999999\n", Verdict.NOTE), ("4000000\n", Verdict.OK), ("?", Verdict.NOTE)]
)
def test_a_small_receive_buffer_is_a_note(monkeypatch: pytest.MonkeyPatch, limit: str, verdict: Verdict) -> None:
    monkeypatch.setattr(Path, "read_text", lambda path: limit)
    row = diagnostics._receive_buffer()  # noqa: SLF001 - other rows read files, too
    assert row.verdict is verdict
    expected = {
        "?": "the system's limit is not known",
        "4000000\n": "up to 4000000 bytes",
        "3999999\n": "up to 3999999 bytes, large LCM messages get lost: sudo sysctl -w net.core.rmem_max=4000000",
    }
    assert row.detail == expected[limit]
