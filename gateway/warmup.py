"""Every compiled kernel of every room: compiled into the cache by child processes, then loaded by the server."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from gateway.ops import kernels


def _drawing() -> None:
    import renderers.fxaa  # noqa: F401 - registers its kernel
    from renderers.cpu import warmup

    warmup()


def _others() -> None:
    import gateway.treeviewer.service  # noqa: F401 - its kernels are compiled, or loaded, when imported
    from gateway.scene.gltf.kernels import warm_up as warm_reader
    from renderers.stereo.warm import warm_up as warm_stereo

    warm_reader()
    warm_stereo()


PARTS: Final[Mapping[str, Callable[[], None]]] = {"drawing": _drawing, "others": _others}
"""Of about equal length, so that two cores halve the time."""


def run(part: str | None = None) -> None:
    """Blocks until the kernels, or those of one part, are loaded. In a serving process: only when they are cached."""
    kernels.configure()
    for name, load in PARTS.items():
        if part is None or name == part:
            load()
