"""The head light: it shines along the optical axis, so that a surface shows its colour times max(0, n . (0, 0, -1))."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.shading.materials import MF_BASE

WHOLE: Final = 2.0**23
"""Added to a float32 of 0 to 255, it leaves the nearest integer in the lowest bits, without a conversion."""
_UPWARDS: Final = 1.0 + 2.0**-22
"""Makes the nearest integer of what lies halfway the upper one."""


@inlined
def _levels(factor):
    """A factor in levels of a byte; at least 0."""
    return vec.f32(max(factor, 0.0) * (255.0 * _UPWARDS))


@inner
def fits(mf):
    """Whether ``shine`` may be used: no factor of the material is above 1."""
    one = np.float32(1.0)
    return mf[MF_BASE] <= one and mf[MF_BASE + 1] <= one and mf[MF_BASE + 2] <= one


@inlined
def colors_of(mf):
    """Red, green and blue of a material, f32x8 each, for ``shine``."""
    return _levels(mf[MF_BASE]), _levels(mf[MF_BASE + 1]), _levels(mf[MF_BASE + 2])


@inlined
def shine(towards, square, colors):
    """Eight lit surfaces, packed (i32x8): red in the lowest byte, then green and blue, each the nearest level; the
    highest byte is anything. Surfaces without a direction are black.

    Args:
        towards, square: of a normal of any length, on the side that is seen: minus its z, and its squared length.
        colors: see ``colors_of``.
    """
    light = vec.least(vec.most(towards / vec.sqrt(square), vec.f32(0.0)), vec.f32(1.0))
    whole = vec.f32(WHOLE)
    red = vec.bits_of(colors[0] * light + whole)
    green = vec.bits_of(colors[1] * light + whole)
    blue = vec.bits_of(colors[2] * light + whole)
    return red | (green << vec.i32(8)) | (blue << vec.i32(16))
