"""Mip levels of minified textures, as OpenGL selects and filters them (OpenGL 4.6, 8.14), eight pixels at a time."""

from __future__ import annotations

from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.shading.texture_table import MIPS_NEAREST, MIPS_NONE

MAGNIFIED: Final = -1
"""Value of ``mip_levels`` for magnified pixels, which read the first level."""


@inlined
def mip_levels(texture, footprint):
    """Return the mip levels that the texture's sampler selects for eight pixels.

    Args:
        footprint: square of the longer side of the pixel's footprint, texels of the first level.

    Returns:
        i32x8, ``MAGNIFIED`` for magnified pixels; f32x8, weight of the next level.
    """
    last, mips = texture.last_level, texture.mips
    # With a linear magnifying and a nearest minifying filter, minification begins at half a level (OpenGL 4.6, 8.14).
    begins_late = texture.mag_linear != 0 and texture.min_linear == 0 and mips != MIPS_NONE
    is_minified = footprint > vec.f32(2.0 if begins_late else 1.0)
    zero = vec.f32(0.0)
    levels, t = vec.i32(0), zero
    if mips != MIPS_NONE:
        detail = vec.minimum(_half_log2(footprint), vec.f32(last))
        if mips == MIPS_NEAREST:
            levels = vec.minimum(vec.to_i32(vec.ceil(detail + vec.f32(0.5))) - vec.i32(1), vec.i32(last))
        else:
            levels = vec.to_i32(detail)
            t = detail - vec.to_f32(levels)
    return vec.select(is_minified, levels, vec.i32(MAGNIFIED)), vec.select(is_minified, t, zero)


@inlined
def _half_log2(x):
    """Return ``log2(x) / 2`` for x >= 1, within 1e-6; 64 or more for infinity and NaN.

    The sum of the exponent and, for the fraction, the series of artanh. The C library's ``log`` is not used, since its
    last bit differs between machines.
    """
    bits = vec.float_bits(x)
    exponent = vec.to_f32((bits >> vec.i32(23)) - vec.i32(127))
    fraction = vec.to_f32(bits & vec.i32(0x7FFFFF)) * vec.f32(1.0 / (1 << 23))
    t = fraction / (fraction + vec.f32(2.0))
    t2 = t * t
    series = vec.f32(1.0 / 9.0) + t2 * vec.f32(1.0 / 11.0)
    series = vec.f32(0.2) + t2 * (vec.f32(1.0 / 7.0) + t2 * series)
    series = t * (vec.f32(1.0) + t2 * (vec.f32(1.0 / 3.0) + t2 * series))
    return vec.f32(0.5) * exponent + series * vec.f32(1.4426950408889634)
