"""Calls wait for kernels that are compiled in the background."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest

from renderers.compiler import pending
from renderers.stop import StopFlag
from tests.support.waiting import SECONDS


@pytest.fixture(autouse=True)
def two_parts() -> Iterator[None]:
    with pending.announced(("a", "b")):
        yield


def wait_in_thread(part: str) -> tuple[threading.Thread, list[object]]:
    results: list[object] = []

    def wait() -> None:
        try:
            pending.wait_until_compiled(part)
            results.append("compiled")
        except Exception as error:  # noqa: BLE001 - what the caller gets
            results.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    return thread, results


def test_a_call_waits_for_its_own_part_only() -> None:
    thread, results = wait_in_thread("a")
    pending.finish("b")
    pending.wait_until_compiled("b")
    assert thread.is_alive()
    assert not results
    pending.finish("a")
    thread.join(SECONDS)
    assert results == ["compiled"]


def test_a_part_that_was_never_announced_is_not_waited_for() -> None:
    pending.wait_until_compiled("c")


def test_the_thread_that_loads_does_not_wait() -> None:
    with pending.loading():
        pending.wait_until_compiled("a")
    thread, _ = wait_in_thread("a")
    pending.finish("a")
    thread.join(SECONDS)
    assert not thread.is_alive()


def test_calls_fail_where_compiling_failed() -> None:
    thread, results = wait_in_thread("a")
    pending.finish("b")
    pending.fail(RuntimeError("no disk"))
    thread.join(SECONDS)
    assert [str(error) for error in results] == ["no disk"]
    with pytest.raises(RuntimeError, match="no disk"):
        pending.wait_until_compiled("a")
    pending.wait_until_compiled("b")


def test_a_call_that_waits_can_be_stopped() -> None:
    flag = StopFlag()
    flag.set(TimeoutError("the deadline"))
    with pytest.raises(TimeoutError, match="the deadline, waiting for kernels that are being compiled"):
        flag.run(lambda: pending.wait_until_compiled("a"))


def test_at_the_end_no_part_is_pending() -> None:
    with pending.announced(("c", "d")):
        thread, results = wait_in_thread("c")
        pending.finish("d")
        assert pending.is_pending("c")
    thread.join(SECONDS)
    assert results == ["compiled"]
    assert not pending.is_pending("c")
    assert pending.is_pending("a")
