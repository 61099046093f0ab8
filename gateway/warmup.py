"""Every compiled kernel of every room: compiled into the cache by a child process, then loaded by the server."""

from __future__ import annotations

from gateway.ops import kernels


def run() -> None:
    """Blocks until every kernel is loaded. In a serving process: only when ``kernels.are_cached``."""
    kernels.configure()
    import gateway.treeviewer.kernels  # noqa: F401 - compiled, or loaded, when imported
    from renderers.cpu import warmup as warm_rasterizer
    from renderers.stereo.warm import warm_up as warm_stereo

    warm_rasterizer()
    warm_stereo()
