"""The compiled kernels of all rooms, in parts.

Child processes compile parts into the kernel cache, and the server loads them. The server is ready when the parts are
loaded that the default settings need. The others are compiled afterwards; a call that needs one of them waits
(``renderers.compiler.pending``). Every child spends seconds on imports and on functions that kernels share, so there
are at most as many children as processors, and each takes one part after the other.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from typing import Any, Final

from gateway.runtime import kernel_cache, process_tuning


def _is_in(kernel: str, names: tuple[str, ...]) -> bool:
    return any(kernel == name or kernel.startswith(f"{name}.") for name in names)


def _kernels_of(*names: str, excluding: tuple[str, ...] = (), modules: tuple[str, ...] = ()) -> Callable[[], None]:
    """Return a function that compiles or loads the kernels with these names, or in modules or packages with them.

    Args:
        modules: modules to import, besides those that draw.
    """

    def compile_them() -> None:
        for module in ("renderers.depth_range", "renderers.fxaa", "renderers.raster", *modules):
            import_module(module)
        from renderers.compiler.jit import KERNELS, compile_kernel

        for kernel in KERNELS:
            name = f"{kernel.py_func.__module__}.{kernel.py_func.__name__}"
            if _is_in(name, names) and not _is_in(name, excluding):
                compile_kernel(kernel)

    return compile_them


_STUDIO: Final = ("renderers.shading.studio",)
_ANTIALIASING: Final = ("renderers.raster.msaa",)
_NORMALS: Final = ("renderers.raster.resolve.resolve_normals", "renderers.shading.mikktspace")
_SETUP: Final = ("renderers.raster.setup",)
_STEREO: Final = tuple(
    f"renderers.stereo.{name}"
    for name in (
        "errors",
        "filters",
        "key_light",
        "matching",
        "mesh",
        "metric_depth",
        "motion_blur",
        "optics",
        "projector",
        "sensor",
        "truth",
    )
)
_FORMATS: Final = (
    "gateway.gltf.meshopt_kernels",
    "gateway.gltf.normals",
    "gateway.gltf.skinning",
    "gateway.scene.crease_normals",
    "gateway.treeviewer.json_kernels",
    "gateway.treeviewer.msgpack_kernels",
)

NEEDED: Final[Mapping[str, Callable[[], None]]] = {
    "shading": _kernels_of("renderers.shading", excluding=(*_STUDIO, *_NORMALS)),
    "raster": _kernels_of(
        "renderers",
        excluding=("renderers.shading", "renderers.stereo", *_STUDIO, *_ANTIALIASING, *_NORMALS, *_SETUP),
    ),
    "setup": _kernels_of(*_SETUP),
}
"""Parts that the default settings need, longest first, so that children end together."""
BACKGROUND: Final[Mapping[str, Callable[[], None]]] = {
    "studio": _kernels_of(*_STUDIO),
    "stereo": _kernels_of("renderers.stereo", modules=_STEREO),
    "normals": _kernels_of(*_NORMALS),
    "antialiasing": _kernels_of(*_ANTIALIASING),
    "formats": _kernels_of(*_FORMATS, modules=_FORMATS),
}
"""Parts that are compiled after the server is ready, longest first: the look of ``/scene/render`` is."""
PARTS: Final[Mapping[str, Callable[[], None]]] = {**NEEDED, **BACKGROUND}
FUNCTIONS: Final[Mapping[str, int]] = {
    "shading": 125,
    "raster": 95,
    "setup": 55,
    "stereo": 60,
    "normals": 35,
    "formats": 20,
    "antialiasing": 55,
    "studio": 135,
}
"""Approximate number of functions that Numba compiles for each part: the scale of the progress bar.

A few more than there are, since LLVM works on after the last one.
"""


def run() -> None:
    """Load the needed parts from the cache; blocks.

    Raises:
        KernelError: a kernel is not in the cache.
    """
    kernel_cache.configure()
    import cv2

    # Images are small, calls come from many threads at once, and idle threads of OpenCV spin.
    cv2.setNumThreads(1)
    with kernel_cache.compiling_refused():
        for load in NEEDED.values():
            load()
        from renderers.raster.warmup import render_first_images

        render_first_images()


def run_background(part: str) -> None:
    """Load a background part from the cache; blocks. Raises as ``run``."""
    from renderers.compiler import pending

    with kernel_cache.compiling_refused(), pending.loading():
        BACKGROUND[part]()
    pending.finish(part)


def compile_parts(queue: int, names: tuple[str, ...]) -> None:
    """Compile parts until none is left; report on stdout each compiled function, and the kernels of each part.

    Args:
        queue: file descriptor with one byte for each part to compile, its index in ``names``. Other processes read
            from it, too.
        names: parts of ``PARTS``.

    Raises:
        KernelError: Numba did not keep a kernel in the cache.
    """
    kernel_cache.configure()
    if set(names) <= set(BACKGROUND):
        os.nice(10)  # the server already runs
    process_tuning.pause_gc()  # compiling makes millions of objects that live until the end
    reported: set[int] = set()
    while index := os.read(queue, 1):
        part = names[index[0]]
        with kernel_cache.functions_reported(partial(_report, part=part)):
            PARTS[part]()
        _report(part=part, kernels=_take_new_folders(reported))


def _report(**fields: Any) -> None:
    sys.stdout.write(json.dumps(fields) + "\n")
    sys.stdout.flush()


def _take_new_folders(reported: set[int]) -> list[str]:
    """Return the names of the cache folders of the kernels compiled since the last call.

    Args:
        reported: ids of the kernels of earlier calls; extended here.
    """
    from renderers.compiler.cache_locator import CACHED, folder_of

    folders: list[str] = []
    for dispatcher in CACHED:
        if dispatcher.signatures and id(dispatcher) not in reported:
            reported.add(id(dispatcher))
            path = folder_of(dispatcher)
            if not any(path.glob("*.nbi")):
                raise kernel_cache.KernelError(f"Numba has not kept {path.name} in the cache")
            folders.append(path.name)
    return folders


if __name__ == "__main__":
    compile_parts(int(sys.argv[1]), tuple(sys.argv[2:]))
