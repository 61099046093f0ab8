"""The CPU rasterizer: visibility by exact fixed-point edge functions, then resolve and shading of what is visible."""

from renderers.raster.renderer import CpuRenderer
from renderers.raster.warmup import warmup

__all__ = ["CpuRenderer", "warmup"]
