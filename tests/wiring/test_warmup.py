"""The parts that child processes compile."""

from __future__ import annotations

import os

import pytest

from gateway.runtime import process_tuning
from gateway.wiring import warmup
from renderers.compiler.jit import KERNELS


def test_parts_are_compiled_until_the_queue_is_empty(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    monkeypatch.setattr(warmup, "PARTS", {name: lambda name=name: done.append(name) for name in "abc"})
    monkeypatch.setattr(process_tuning, "pause_gc", lambda: None)  # it stops the garbage collector
    queue, queue_input = os.pipe()
    os.write(queue_input, bytes((2, 0)))
    os.close(queue_input)
    warmup.compile_parts(queue, ("a", "b", "c"))
    os.close(queue)
    assert done == ["c", "a"]


def test_every_kernel_is_in_one_part(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[object] = []
    monkeypatch.setattr("renderers.compiler.jit.compile_kernel", compiled.append)
    for compile_part in warmup.PARTS.values():
        compile_part()
    assert len(compiled) == len(set(map(id, compiled)))
    assert set(map(id, compiled)) == set(map(id, KERNELS))
