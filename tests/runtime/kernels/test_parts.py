"""The parts that child processes compile."""

import os
from pathlib import Path

import pytest

from gateway.runtime.kernels import compile_process
from gateway.runtime.kernels.cache import KernelError
from gateway.runtime.kernels.parts import PARTS, KernelPart
from gateway.runtime.workers import process_tuning
from renderers.compiler.jit import KERNELS, Kernel


@pytest.mark.parametrize(("background", "changes"), [("abcd", [10]), ("ab", [])])
def test_parts_are_compiled_until_the_queue_is_empty(
    background: str, changes: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A process that compiles what a running server waits for has the server's priority."""
    done: list[str] = []
    niceness: list[int] = []
    monkeypatch.setattr(os, "nice", niceness.append)
    monkeypatch.setattr(compile_process, "BACKGROUND", tuple(background))
    monkeypatch.setattr(KernelPart, "compile_or_load", lambda part: done.append(part.names[0]))
    monkeypatch.setattr(compile_process, "PARTS", {name: KernelPart(1, (name,)) for name in "abc"})
    monkeypatch.setattr(process_tuning, "pause_gc", lambda: None)  # it stops the garbage collector
    queue, queue_input = os.pipe()
    os.write(queue_input, bytes((2, 0)))
    os.close(queue_input)
    compile_process.compile_parts(queue, ("a", "b", "c"))
    os.close(queue)
    assert done == ["c", "a"]
    assert niceness == changes


class Function:
    """A compiled function, as Numba has it."""

    def __init__(self, folder: Path, *, compiled: bool = True, kept: bool = True) -> None:
        self.folder = folder
        self.signatures = ["void(int64)"] if compiled else []
        folder.mkdir()
        if kept:
            (folder / "index.nbi").touch()


def test_the_folders_of_a_part_are_those_compiled_for_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    functions = [Function(tmp_path / "a"), Function(tmp_path / "b", compiled=False)]
    monkeypatch.setattr("renderers.compiler.cache_locator.CACHED_KERNELS", functions)
    monkeypatch.setattr("renderers.compiler.cache_locator.folder_of", lambda function: function.folder)
    reported: set[int] = set()
    assert compile_process._take_new_folders(reported) == ["a"]  # noqa: SLF001 - no public way to call it alone
    functions.append(Function(tmp_path / "c"))
    assert compile_process._take_new_folders(reported) == ["c"]  # noqa: SLF001 - no public way to call it alone
    functions.append(Function(tmp_path / "d", kept=False))
    with pytest.raises(KernelError, match="Numba has not stored d in the cache"):
        compile_process._take_new_folders(reported)  # noqa: SLF001 - no public way to call it alone


def test_every_kernel_is_in_one_part(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled: list[object] = []
    monkeypatch.setattr(Kernel, "compile", lambda kernel: compiled.append(kernel))
    for part in PARTS.values():
        part.compile_or_load()
    assert len(compiled) == len(set(map(id, compiled)))
    assert set(map(id, compiled)) == set(map(id, KERNELS))
