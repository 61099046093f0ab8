"""Every compiled kernel of every room: compiled into the cache by child processes, then loaded by the server.

Every child spends seconds on importing and on functions that kernels have in common, so that there are few, as many as
processors; they take the parts one after the other.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping
from typing import Any, Final

from gateway.ops import kernels, process


def _kernels_of(*modules: str, but: tuple[str, ...] = ()) -> Callable[[], None]:
    """Compiles the rasterizer's kernels of these modules."""

    def compile_them() -> None:
        import renderers.cpu
        import renderers.depthlimits
        import renderers.fxaa  # noqa: F401 - they register their kernels
        from renderers.jit import KERNELS, compile_kernel

        for kernel in KERNELS:
            module = kernel.py_func.__module__
            if module.startswith(modules) and not module.startswith(but):
                compile_kernel(kernel)

    return compile_them


def _treeviewer() -> None:
    import gateway.scene.creases
    import gateway.treeviewer.binary_kernels
    import gateway.treeviewer.kernels  # noqa: F401 - they are compiled, or loaded, when imported


def _stereo() -> None:
    from gateway.scene.gltf.kernels import warm_up as warm_reader
    from renderers.stereo.warm import warm_up as warm_stereo

    warm_reader()
    warm_stereo()


_APART: Final = ("renderers.shading", "renderers.studio", "renderers.cpu.setup", "renderers.cpu.edges")

PARTS: Final[Mapping[str, Callable[[], None]]] = {
    "shading": _kernels_of("renderers.shading"),
    "studio": _kernels_of("renderers.studio"),
    "setup": _kernels_of("renderers.cpu.setup"),
    "rest": _kernels_of("renderers", but=_APART),
    "edges": _kernels_of("renderers.cpu.edges"),
    "stereo": _stereo,
    "treeviewer": _treeviewer,
}
"""Handed out in this order, which is that of their length (12 to 4 s of one core), so that children end together."""


def run() -> None:
    """Load all kernels from the cache; blocks. For serving processes: nothing is compiled.

    Raises:
        KernelError: a kernel is not in the cache.
    """
    kernels.configure()
    import cv2

    # Its pictures are small, calls come from many threads at once, and those of its own wait in loops.
    cv2.setNumThreads(1)
    with kernels.compiling_refused():
        for load in PARTS.values():
            load()
        from renderers.cpu import warmup as first_pictures

        first_pictures()


def compile_parts(numbers: int) -> None:
    """Compile parts until none is left; tell on stdout which one begins, and which kernels one had when it ends.

    Args:
        numbers: a descriptor that a byte is read from for each part, its place in ``PARTS``; other processes read from
            it, too.

    Raises:
        KernelError: Numba did not keep a kernel in the cache.
    """
    kernels.configure()
    process.hurry()  # compiling makes millions of objects, none of which is garbage before all is done
    from renderers.remembered import remember

    remember()
    parts = tuple(PARTS)
    known: set[int] = set()
    while number := os.read(numbers, 1):
        part = parts[number[0]]
        _tell(part=part)
        PARTS[part]()
        _tell(part=part, kernels=_compiled_since(known))


def _tell(**report: Any) -> None:
    sys.stdout.write(json.dumps(report) + "\n")
    sys.stdout.flush()


def _compiled_since(known: set[int]) -> list[str]:
    """Names of the cache folders of kernels that are not in ``known`` yet, which is updated."""
    from renderers.cache_locator import CACHED, cache_folder

    folders: list[str] = []
    for dispatcher in CACHED:
        if dispatcher.signatures and id(dispatcher) not in known:
            known.add(id(dispatcher))
            path = cache_folder(dispatcher)
            if not any(path.glob("*.nbi")):
                raise kernels.KernelError(f"Numba has not kept {path.name} in the cache")
            folders.append(path.name)
    return folders


if __name__ == "__main__":
    compile_parts(int(sys.argv[1]))
