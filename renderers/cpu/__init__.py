"""The CPU rasterizer: visibility by exact fixed-point edge functions, then resolve and shading of what is visible."""

from __future__ import annotations

from renderers.cpu.renderer import CpuRenderer
from renderers.cpu.warmup import warmup

__all__ = ["CpuRenderer", "warmup"]
