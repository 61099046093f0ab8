"""The parts that child processes compile."""

from __future__ import annotations

import os

import pytest

from gateway.runtime import process_tuning
from gateway.wiring import warmup
from renderers.compiler.jit import KERNELS


def test_parts_are_taken_until_none_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    monkeypatch.setattr(warmup, "PARTS", {name: lambda name=name: done.append(name) for name in "abc"})
    monkeypatch.setattr(process_tuning, "pause_gc", lambda: None)  # it stops the garbage collector
    numbers, told = os.pipe()
    os.write(told, bytes((2, 0)))
    os.close(told)
    warmup.compile_parts(numbers, ("a", "b", "c"))
    os.close(numbers)
    assert done == ["c", "a"]


def test_every_kernel_is_in_one_part(monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[object] = []
    monkeypatch.setattr("renderers.compiler.jit.compile_kernel", taken.append)
    for name, compile_part in warmup.PARTS.items():
        if name not in ("stereo", "formats"):
            compile_part()
    assert len(taken) == len(set(map(id, taken)))
    assert set(map(id, taken)) == {id(k) for k in KERNELS if k.py_func.__module__.startswith("renderers.")}
