"""Compilation of the kernels ahead of their first use."""

from __future__ import annotations

import renderers.shading.headlight.passes  # noqa: F401 - all kernels are imported by it
from renderers.compiler.jit import compile_all


def warmup() -> None:
    """Compiles every kernel, or loads it from Numba's cache. There is one signature per kernel: looks, textures,
    topologies and modes are values, not types."""
    compile_all()
