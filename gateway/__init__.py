"""Scenegate: a sensor stack without camera, GPU or display, on one scene and one CPU rasterizer."""

from __future__ import annotations

from typing import Final

__version__: Final = "0.1.0"
