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

from gateway.runtime import kernel_cache, process_tuning


def _kernels_of(*modules: str, but: tuple[str, ...] = ()) -> Callable[[], None]:
    """Compiles the rasterizer's kernels of these modules."""

    def compile_them() -> None:
        import renderers.depth_range
        import renderers.fxaa
        import renderers.raster  # noqa: F401
        from renderers.compiler.jit import KERNELS, compile_kernel

        for kernel in KERNELS:
            module = kernel.py_func.__module__
            if module.startswith(modules) and not module.startswith(but):
                compile_kernel(kernel)

    return compile_them


def _treeviewer() -> None:
    import gateway.scene.crease_normals
    import gateway.treeviewer.json_kernels
    import gateway.treeviewer.msgpack_kernels  # noqa: F401


def _stereo() -> None:
    from gateway.gltf.normals import warm_up as warm_reader
    from renderers.stereo.warmup import warm_up as warm_stereo

    warm_reader()
    warm_stereo()


_APART: Final = (
    "renderers.shading",
    "renderers.raster.setup",
    "renderers.raster.msaa.edges",
)

PARTS: Final[Mapping[str, Callable[[], None]]] = {
    "shading": _kernels_of("renderers.shading", but=("renderers.shading.studio",)),
    "studio": _kernels_of("renderers.shading.studio"),
    "setup": _kernels_of("renderers.raster.setup"),
    "rest": _kernels_of("renderers", but=_APART),
    "edges": _kernels_of("renderers.raster.msaa.edges"),
    "stereo": _stereo,
    "treeviewer": _treeviewer,
}
"""Handed out in this order, which is that of their length (12 to 4 s of one core), so that children end together."""


def run() -> None:
    """Load all kernels from the cache; blocks. For serving processes: nothing is compiled.

    Raises:
        KernelError: a kernel is not in the cache.
    """
    kernel_cache.configure()
    import cv2

    # Its pictures are small, calls come from many threads at once, and those of its own wait in loops.
    cv2.setNumThreads(1)
    with kernel_cache.compiling_refused():
        for load in PARTS.values():
            load()
        from renderers.raster import warmup as first_pictures

        first_pictures()


def compile_parts(numbers: int) -> None:
    """Compile parts until none is left; tell on stdout which one begins, and which kernels one had when it ends.

    Args:
        numbers: a descriptor that a byte is read from for each part, its place in ``PARTS``; other processes read from
            it, too.

    Raises:
        KernelError: Numba did not keep a kernel in the cache.
    """
    kernel_cache.configure()
    process_tuning.pause_gc()  # compiling makes millions of objects, none of which is garbage before all is done
    from renderers.compiler.remembered import remember

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
    from renderers.compiler.cache_locator import CACHED, folder_of

    folders: list[str] = []
    for dispatcher in CACHED:
        if dispatcher.signatures and id(dispatcher) not in known:
            known.add(id(dispatcher))
            path = folder_of(dispatcher)
            if not any(path.glob("*.nbi")):
                raise kernel_cache.KernelError(f"Numba has not kept {path.name} in the cache")
            folders.append(path.name)
    return folders


if __name__ == "__main__":
    compile_parts(int(sys.argv[1]))
