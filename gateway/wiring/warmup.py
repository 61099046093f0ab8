"""The compiled kernels of all rooms, in parts.

Child processes compile parts into the kernel cache, and the server loads them. It is ready when it has loaded the parts
that the default settings need. The others follow in the background; a call that needs one of them waits
(``renderers.compiler.pending``). Each child compiles several parts, since it spends seconds on imports and on functions
that the parts share.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from pkgutil import walk_packages
from typing import Any, Final

from gateway.runtime import kernel_cache, process_tuning


def _is_in(kernel: str, names: tuple[str, ...]) -> bool:
    """Return True if a kernel has one of these names, or is in a module or package with one of them."""
    return any(kernel == name or kernel.startswith(f"{name}.") for name in names)


def _kernels_of(*names: str, excluding: tuple[str, ...] = (), modules: tuple[str, ...] = ()) -> Callable[[], None]:
    """Return a function that compiles the kernels of a part, or loads them from the cache.

    Args:
        names: full names of the kernels, or of modules or packages with them.
        excluding: names as above, of kernels that are left out.
        modules: modules and packages that define the kernels, besides those of the rasterizer.
    """

    def compile_or_load() -> None:
        for module in ("renderers.depth_range", "renderers.fxaa", "renderers.raster", *modules):
            package = import_module(module)
            for each in walk_packages(getattr(package, "__path__", ()), f"{module}."):
                import_module(each.name)
        from renderers.compiler.jit import KERNELS, compile_kernel

        for kernel in KERNELS:
            name = f"{kernel.py_func.__module__}.{kernel.py_func.__name__}"
            if _is_in(name, names) and not _is_in(name, excluding):
                compile_kernel(kernel)

    return compile_or_load


_STUDIO: Final = ("renderers.shading.studio",)
_ANTIALIASING: Final = ("renderers.raster.msaa",)
_NORMALS: Final = ("renderers.raster.resolve.resolve_normals", "renderers.shading.mikktspace")
_SETUP: Final = ("renderers.raster.setup",)
_FORMATS: Final = (
    "gateway.gltf.meshopt_kernels",
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
"""Parts that the default settings need; the longest first, so that the children end at about the same time."""
BACKGROUND: Final[Mapping[str, Callable[[], None]]] = {
    "studio": _kernels_of(*_STUDIO),
    "stereo": _kernels_of("renderers.stereo", modules=("renderers.stereo",)),
    "normals": _kernels_of(*_NORMALS),
    "antialiasing": _kernels_of(*_ANTIALIASING),
    "formats": _kernels_of(*_FORMATS, modules=_FORMATS),
}
"""Parts that are compiled after the server is ready, longest first: the look of ``/scene/render`` is."""
PARTS: Final[Mapping[str, Callable[[], None]]] = {**NEEDED, **BACKGROUND}
FUNCTION_COUNTS: Final[Mapping[str, int]] = {
    "shading": 125,
    "raster": 95,
    "setup": 55,
    "stereo": 60,
    "normals": 35,
    "formats": 20,
    "antialiasing": 55,
    "studio": 135,
}
"""Number of functions that Numba compiles for each part: the scale of the progress bar.

Each is a little too large, so that the bar is not full while LLVM still works.
"""


def load_needed() -> None:
    """Load the parts that the default settings need from the cache. This blocks.

    Raises:
        KernelError: a kernel is not in the cache.
    """
    kernel_cache.configure()
    import cv2

    # One thread per call: many threads call OpenCV at once with small images, and its idle threads spin.
    cv2.setNumThreads(1)
    with kernel_cache.forbid_compiling():
        for load in NEEDED.values():
            load()
        from renderers.raster.warmup import render_first_images

        render_first_images()


def load_background(part: str) -> None:
    """Load a background part from the cache, and end the wait for it. This blocks. Raises as ``load_needed``."""
    from renderers.compiler import pending

    with kernel_cache.forbid_compiling(), pending.loading():
        BACKGROUND[part]()
    pending.finish(part)


def compile_parts(queue: int, names: tuple[str, ...]) -> None:
    """Compile parts until none is left. Report each compiled function and part on stdout, as JSON lines.

    Args:
        queue: file descriptor of a pipe with one byte for each part to compile, its index in ``names``. Several
            processes read from it.
        names: parts of ``PARTS``.

    Raises:
        KernelError: Numba has not stored a kernel in the cache.
    """
    kernel_cache.configure()
    if set(names) <= set(BACKGROUND):
        os.nice(10)  # the server already runs
    process_tuning.pause_gc()  # compiling makes millions of objects that live until the end
    reported: set[int] = set()
    while index := os.read(queue, 1):
        part = names[index[0]]
        with kernel_cache.report_compiled_functions(partial(_report, part=part)):
            PARTS[part]()
        _report(part=part, kernels=_take_new_folders(reported))


def _report(**fields: Any) -> None:
    sys.stdout.write(json.dumps(fields) + "\n")
    sys.stdout.flush()


def _take_new_folders(reported: set[int]) -> list[str]:
    """Return the names of the cache folders of the kernels that were compiled since the last call.

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
                raise kernel_cache.KernelError(f"Numba has not stored {path.name} in the cache")
            folders.append(path.name)
    return folders


if __name__ == "__main__":
    compile_parts(int(sys.argv[1]), tuple(sys.argv[2:]))
