"""Shading."""

from __future__ import annotations

from renderers.shading.headlight.passes import Painter, paint
from renderers.shading.headlight.warmup import warmup
from renderers.shading.materials import look_material
from renderers.shading.scene import ShadingScene, prepare
from renderers.shading.texture_table import Parallel
from renderers.shading.textures import texels_of

__all__ = [
    "Painter",
    "Parallel",
    "ShadingScene",
    "look_material",
    "paint",
    "prepare",
    "texels_of",
    "warmup",
]
