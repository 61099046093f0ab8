"""Kernels wait until they are compiled in the background."""

import threading
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, ClassVar

import pytest
from numba import types

from renderers.compiler import pending
from renderers.compiler.jit import Kernel
from renderers.compiler.kernel_types import KernelSignature
from renderers.stop import StopFlag
from tests.support.waiting import SECONDS


@pytest.fixture(autouse=True)
def two_parts() -> Iterator[None]:
    with pending.announced({"a": lambda name: name.startswith("a."), "b": lambda name: name.startswith("b.")}):
        yield


def wait_in_thread(name: str) -> tuple[threading.Thread, list[object]]:
    results: list[object] = []

    def wait() -> None:
        try:
            pending.wait_for_kernel(name)
            results.append("compiled")
        except Exception as error:  # noqa: BLE001 - what the caller gets
            results.append(error)

    thread = threading.Thread(target=wait)
    thread.start()
    return thread, results


def test_a_kernel_waits_for_its_own_part_only() -> None:
    thread, results = wait_in_thread("a.first")
    pending.finish("b")
    pending.wait_for_kernel("b.first")
    assert thread.is_alive()
    assert not results
    pending.finish("a")
    thread.join(SECONDS)
    assert results == ["compiled"]


def test_kernels_of_parts_that_were_never_announced_do_not_wait() -> None:
    pending.wait_for_kernel("c.first")


def test_calls_wait_under_the_name_of_the_kernel() -> None:
    def square(x: float) -> float:
        return x * x

    class Dispatcher:
        py_func = square
        overloads: ClassVar[dict[Any, Any]] = {
            (types.float64,): SimpleNamespace(signature=SimpleNamespace(return_type=types.float64))
        }

        def compile(self, arguments: object) -> None: ...

        def disable_compile(self) -> None: ...

        def __call__(self, x: float) -> float:
            return x * x

    square.__module__ = "a"
    kernel: Kernel[[float], float] = Kernel(Dispatcher(), KernelSignature(square))
    with pytest.raises(pending.KernelsPending):
        StopFlag(waits=False).run(lambda: kernel(3.0))
    pending.finish("a")
    assert kernel(3.0) == 9.0


def test_kernels_fail_where_compiling_failed() -> None:
    thread, results = wait_in_thread("a.first")
    pending.finish("b")
    pending.fail(4)
    thread.join(SECONDS)
    assert [(type(error), getattr(error, "retry_after", 0)) for error in results] == [(pending.KernelsDelayed, 4)]
    with pytest.raises(pending.KernelsDelayed, match="could not be loaded, which is tried again"):
        StopFlag(waits=False).run(lambda: pending.wait_for_kernel("a.first"))
    pending.wait_for_kernel("b.first")


def test_at_the_end_no_part_is_pending() -> None:
    with pending.announced({"c": lambda name: name.startswith("c."), "d": lambda name: False}):
        thread, results = wait_in_thread("c.first")
        pending.finish("d")
        assert pending.is_pending("c")
    thread.join(SECONDS)
    assert results == ["compiled"]
    assert not pending.is_pending("c")
    assert pending.is_pending("a")
