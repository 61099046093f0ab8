"""Listening, and what is said when it does not work."""

from __future__ import annotations

import gc
import resource
import socket
import sys

import pytest

from gateway.ops import process


def test_listening_on_a_free_port() -> None:
    with process.listen("127.0.0.1", 0) as sock, socket.create_connection(sock.getsockname()[:2]):
        pass


def test_a_taken_port_is_said_so() -> None:
    with process.listen("127.0.0.1", 0) as sock:
        port = sock.getsockname()[1]
        with pytest.raises(OSError, match="in use") as raised:
            process.listen("127.0.0.1", port)
    reason = process.why_not_listening(raised.value, "127.0.0.1", port)
    assert reason == f"another program listens there (127.0.0.1 port {port})"


def test_an_address_of_another_machine_is_said_so() -> None:
    with pytest.raises(OSError, match="assign") as raised:
        process.listen("203.0.113.1", 0)
    assert "203.0.113.1 is no address of this machine" in process.why_not_listening(raised.value, "203.0.113.1", 0)


def test_an_unknown_host_is_said_so() -> None:
    with pytest.raises(socket.gaierror) as raised:
        process.listen("no such host", 0)
    assert process.why_not_listening(raised.value, "no such host", 0) == "the host 'no such host' is unknown"


def test_tuning_never_lowers_the_number_of_files() -> None:
    before, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    process.tune()
    after, same = resource.getrlimit(resource.RLIMIT_NOFILE)
    assert same == hard
    assert after >= before or before == resource.RLIM_INFINITY


def test_threads_let_the_event_loop_have_its_turn_within_a_millisecond() -> None:
    before = sys.getswitchinterval()
    try:
        process.tune()
        assert sys.getswitchinterval() <= 0.0011
    finally:
        sys.setswitchinterval(before)


def test_the_garbage_collector_works_again_after_the_start() -> None:
    frozen = gc.get_freeze_count()
    try:
        process.hurry()
        assert not gc.isenabled()
        process.settle()
        assert gc.isenabled()
        assert gc.get_freeze_count() > frozen
    finally:
        gc.unfreeze()
        gc.enable()
