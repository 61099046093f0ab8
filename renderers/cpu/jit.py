"""The package's way to compile kernels: ``renderers.jit``, which shading and filters use, too."""

from __future__ import annotations

from renderers.jit import KERNELS, compile_all, kernel

__all__ = ["KERNELS", "compile_all", "kernel"]
