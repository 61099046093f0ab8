"""Every compiled kernel of every room: compiled into the cache by child processes, then loaded by the server."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from gateway.ops import kernels

_SHADING: Final = "renderers.shading"
_STUDIO: Final = "renderers.studio"


def _compile(wanted: Callable[[str], bool]) -> None:
    """The rasterizer's kernels whose module is wanted."""
    import renderers.cpu
    import renderers.encode
    import renderers.fxaa  # noqa: F401 - they register their kernels
    from renderers.jit import KERNELS, compile_kernel

    for kernel in KERNELS:
        if wanted(kernel.py_func.__module__):
            compile_kernel(kernel)


def _visibility() -> None:
    _compile(lambda module: not module.startswith((_SHADING, _STUDIO)))


def _shading() -> None:
    _compile(lambda module: module.startswith(_SHADING))


def _studio() -> None:
    _compile(lambda module: module.startswith(_STUDIO))


def _others() -> None:
    import gateway.treeviewer.service  # noqa: F401 - its kernels are compiled, or loaded, when imported
    from gateway.scene.gltf.kernels import warm_up as warm_reader
    from renderers.stereo.warm import warm_up as warm_stereo

    warm_reader()
    warm_stereo()


PARTS: Final[Mapping[str, Callable[[], None]]] = {
    "visibility": _visibility,
    "shading": _shading,
    "studio": _studio,
    "others": _others,
}
"""Of about equal length (10 to 20 s of one core), compiled at the same time."""


def run(part: str | None = None) -> None:
    """Blocks until the kernels, or those of one part, are loaded. In a serving process: only when they are cached."""
    kernels.configure()
    if part is not None:
        PARTS[part]()
        return
    for load in PARTS.values():
        load()
    from renderers.cpu import warmup as first_pictures

    first_pictures()
