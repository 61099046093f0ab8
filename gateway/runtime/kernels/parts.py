"""The compiled kernels of all rooms, in parts.

Child processes compile parts into the kernel cache, and the server loads them. It is ready when it has loaded the parts
that the default settings need. The others follow in the background; a call that needs one of them waits
(``renderers.compiler.pending``). Each child compiles several parts, since it spends seconds on imports and on functions
that the parts share.
"""

import asyncio
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from importlib import import_module
from pkgutil import walk_packages
from typing import Final

from gateway.runtime.kernels import cache
from gateway.runtime.kernels.progress import KernelProgress, show_progress, write_progress
from renderers.compiler import pending


def _is_in(kernel: str, names: tuple[str, ...]) -> bool:
    """Return True if a kernel has one of these names, or is in a module or package with one of them."""
    return any(kernel == name or kernel.startswith(f"{name}.") for name in names)


@dataclass(frozen=True, slots=True)
class KernelPart:
    """Kernels that are compiled together."""

    function_count: int
    """Number of functions that Numba compiles: the scale of the progress bar. A little too large, so that the bar is
    not full while LLVM still works."""
    names: tuple[str, ...]
    """Full names of the kernels, or of modules or packages with them."""
    excluding: tuple[str, ...] = ()
    """Names as above, of kernels that are left out."""
    modules: tuple[str, ...] = ()
    """Modules and packages that define the kernels, besides those of the rasterizer."""

    def has_kernel(self, name: str) -> bool:
        """Return True for the full name of a kernel of this part."""
        return _is_in(name, self.names) and not _is_in(name, self.excluding)

    def compile_or_load(self) -> None:
        """Compile the kernels, or load them from the cache."""
        for module in ("renderers.depth_range", "renderers.fxaa", "renderers.raster", *self.modules):
            package = import_module(module)
            for each in walk_packages(getattr(package, "__path__", ()), f"{module}."):
                import_module(each.name)
        from renderers.compiler.jit import KERNELS

        for kernel in KERNELS:
            if self.has_kernel(kernel.name):
                kernel.compile()


_STUDIO: Final = ("renderers.shading.studio",)
_ANTIALIASING: Final = ("renderers.raster.msaa",)
_NORMALS: Final = ("renderers.raster.resolve_normals", "renderers.shading.mikktspace")
_ATTRIBUTES: Final = ("renderers.shading.span_setup", "renderers.shading.sampling")
_HEADLIGHT: Final = ("renderers.shading.headlight",)
_SETUP: Final = ("renderers.raster.setup",)
_COVERAGE: Final = ("renderers.raster.coverage",)
_FORMATS: Final = (
    "gateway.files.gltf.meshopt_kernels",
    "gateway.scene.draw.crease_normals",
    "gateway.scene.draw.equal_rows",
    "gateway.adapters.treeviewer.json_kernels",
    "gateway.adapters.treeviewer.msgpack_kernels",
)

NEEDED: Final[Mapping[str, KernelPart]] = {
    "attributes": KernelPart(71, _ATTRIBUTES),
    "shading": KernelPart(67, _HEADLIGHT),
    "setup": KernelPart(55, _SETUP),
    "coverage": KernelPart(49, _COVERAGE),
    "frame": KernelPart(34, ("renderers.raster",), excluding=(*_SETUP, *_COVERAGE, *_ANTIALIASING, *_NORMALS)),
    "images": KernelPart(
        11,
        ("renderers",),
        excluding=("renderers.raster", "renderers.stereo", *_HEADLIGHT, *_ATTRIBUTES, *_STUDIO, *_NORMALS),
    ),
}
"""Parts that the default settings need, none above a quarter of the time; the longest first, so that the children end
at about the same time."""
BACKGROUND: Final[Mapping[str, KernelPart]] = {
    "formats": KernelPart(43, _FORMATS, modules=_FORMATS),
    "studio": KernelPart(84, _STUDIO),
    "stereo": KernelPart(100, ("renderers.stereo",), modules=("renderers.stereo",)),
    "normals": KernelPart(31, _NORMALS),
    "antialiasing": KernelPart(63, _ANTIALIASING),
}
"""Parts that are compiled after the server is ready: first what published meshes need, then the longest first."""
PARTS: Final[Mapping[str, KernelPart]] = {**NEEDED, **BACKGROUND}


def ensure_compiled(*, show: bool = False) -> None:
    """Compile the kernels that are not cached, if wanted with progress. Processes of a machine take turns.

    Call it before any kernel is imported, and not in a running event loop. Raises KernelError.
    """
    if cache.are_cached(PARTS):
        return
    progress = KernelProgress({name: part.function_count for name, part in PARTS.items()})
    with show_progress(progress, write_progress) if show else nullcontext():
        asyncio.run(cache.compile_missing(PARTS, progress))


def load_needed() -> None:
    """Load the parts that default settings need. This blocks. Raises KernelError if a kernel is not in the cache."""
    cache.configure()
    import cv2

    # One thread per call: many threads call OpenCV at once with small images, and its idle threads spin.
    cv2.setNumThreads(1)
    with cache.forbid_compiling():
        for part in NEEDED.values():
            part.compile_or_load()
        from renderers.raster.warmup import render_first_images

        render_first_images()


def load_background(part: str) -> None:
    """Load a background part from the cache, and end the wait for it. This blocks. Raises as ``load_needed``."""
    with cache.forbid_compiling():
        BACKGROUND[part].compile_or_load()
    pending.finish(part)
