"""Listening sockets and their errors, and settings of the process."""

import gc
import platform
import resource
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from gateway.runtime.workers import process_tuning
from tests.support.waiting import SECONDS


def received(sock: socket.socket) -> int:
    return sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


@pytest.mark.parametrize("host", ["127.0.0.1", "::1"])
def test_receive_buffer_is_large_if_allowed(host: str) -> None:
    try:
        listener = process_tuning.listen(host, 0)
    except OSError:
        pytest.skip(f"{host} is not an address of this machine")
    with listener, socket.socket(listener.family) as other:
        by_itself = received(other)
        other.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
        allowed = received(other)
        assert received(listener) == (allowed if allowed >= 8 << 20 else by_itself)  # Linux doubles it


def test_receive_buffer_is_automatic_if_half_of_it_is_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    largest = int(Path("/proc/sys/net/core/rmem_max").read_text())
    for size, fixed in ((largest, True), (largest * 3 // 2, False)):
        monkeypatch.setattr(process_tuning, "_TCP_BUFFER_BYTES", size)
        with process_tuning.listen("127.0.0.1", 0) as listener, socket.socket() as other:
            assert (received(listener) != received(other)) is fixed


def test_error_for_a_port_in_use() -> None:
    with process_tuning.listen("127.0.0.1", 0) as sock:
        port = sock.getsockname()[1]
        with pytest.raises(OSError, match="in use") as raised:
            process_tuning.listen("127.0.0.1", port)
    reason = process_tuning.listen_error(raised.value, "127.0.0.1", port)
    assert reason == f"another program listens there (127.0.0.1 port {port})"


def test_error_for_an_address_of_another_machine() -> None:
    with pytest.raises(OSError, match="assign") as raised:
        process_tuning.listen("203.0.113.1", 0)
    assert "203.0.113.1 is not an address of this machine" in process_tuning.listen_error(
        raised.value, "203.0.113.1", 0
    )


def test_error_for_an_unknown_host() -> None:
    with pytest.raises(socket.gaierror) as raised:
        process_tuning.listen("no such host", 0)
    assert process_tuning.listen_error(raised.value, "no such host", 0) == "the host 'no such host' is unknown"


def test_tuning_never_lowers_the_descriptor_limit() -> None:
    before, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    process_tuning.tune()
    after, same = resource.getrlimit(resource.RLIMIT_NOFILE)
    assert same == hard
    assert after >= before or before == resource.RLIM_INFINITY


def test_switch_interval_is_a_millisecond() -> None:
    before = sys.getswitchinterval()
    try:
        process_tuning.tune()
        assert sys.getswitchinterval() <= 0.0011
    finally:
        sys.setswitchinterval(before)


REUSE = """
import resource
import threading
from gateway.runtime.workers import process_tuning

def fill() -> None:
    for _ in range(3):
        before = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
        bytearray(b"x") * (100 << 20)
    print(resource.getrusage(resource.RUSAGE_THREAD).ru_minflt - before)

process_tuning.tune()
thread = threading.Thread(target=fill)
thread.start()
thread.join()
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the allocator of glibc")
def test_large_freed_memory_is_used_again_by_other_threads_than_the_main_one() -> None:
    program = [sys.executable, "-c", REUSE]
    new_pages = int(subprocess.run(program, check=True, capture_output=True, text=True, timeout=SECONDS).stdout)
    assert new_pages < 1000  # of 25,600


def test_the_garbage_collector_works_again_after_the_start() -> None:
    frozen = gc.get_freeze_count()
    try:
        process_tuning.pause_gc()
        assert not gc.isenabled()
        process_tuning.freeze_gc()
        assert gc.isenabled()
        assert gc.get_freeze_count() > frozen
    finally:
        gc.unfreeze()
        gc.enable()


def test_a_process_whose_parent_has_already_ended_ends() -> None:
    """A supervisor that is killed while it starts a process left that process running."""
    program = """
import multiprocessing, os, time
from gateway.runtime.workers import process_tuning

def run():
    while os.getppid() == multiprocessing.parent_process().pid:
        time.sleep(0.01)
    print("started", flush=True)
    process_tuning.end_with_parent()
    print("still running", flush=True)

multiprocessing.get_context("fork").Process(target=run).start()
os._exit(0)
"""
    output = subprocess.run([sys.executable, "-c", program], stdout=subprocess.PIPE, timeout=SECONDS).stdout
    assert output == b"started\n"
