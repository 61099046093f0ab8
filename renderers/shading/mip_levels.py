"""Mip levels of minified textures, as OpenGL selects and filters them (OpenGL 4.6, 8.14), eight pixels at a time."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.shading.texels import sample_level, select4
from renderers.shading.texture_table import MIPS_NEAREST, MIPS_NONE

_NO_LEVEL: Final = 1 << 20
"""Greater than every index of a mip level."""


@inlined
def _lerp4(a, b, t):
    return (
        a[0] + t * (b[0] - a[0]),
        a[1] + t * (b[1] - a[1]),
        a[2] + t * (b[2] - a[2]),
        a[3] + t * (b[3] - a[3]),
    )


@inlined
def _sample_between(texture, sampler, k, t, u, v):
    """Return RGBA of a minified texture, interpolated between the mip levels ``k`` and ``k + 1``.

    Args:
        t: f32x8, weight of level ``k + 1``.
    """
    min_linear = texture.min_linear != 0
    rgba = sample_level(texture, sampler, k, min_linear, u, v)
    if vec.movemask(t > vec.f32(0.0)) != 0:
        next_level = min(k + 1, texture.level_count - 1)
        rgba = _lerp4(rgba, sample_level(texture, sampler, next_level, min_linear, u, v), t)
    return rgba


@inlined
def mip_levels(texture, footprint):
    """Return the mip levels that the texture's sampler selects for eight pixels.

    Args:
        footprint: square of the longer side of the pixel's footprint, texels of the first level.

    Returns:
        i32x8, ``_NO_LEVEL`` for magnified pixels; f32x8, weight of the next level.
    """
    last, mips = texture.level_count - 1, texture.mips
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
    return vec.select(is_minified, levels, vec.i32(_NO_LEVEL)), vec.select(is_minified, t, zero)


@inlined
def sample_mipmapped(texture, sampler, u, v, levels, t):
    """Return RGBA from mip levels; ``levels`` and ``t`` are from ``mip_levels``."""
    no_level = vec.i32(_NO_LEVEL)
    k = vec.minimum_of(levels)
    if k == _NO_LEVEL:
        return sample_level(texture, sampler, np.int64(0), texture.mag_linear != 0, u, v)
    if vec.movemask(levels == vec.i32(k)) == 255:  # nearly always
        return _sample_between(texture, sampler, k, t, u, v)
    zero = vec.f32(0.0)
    rgba = zero, zero, zero, zero
    if vec.movemask(levels == no_level) != 0:
        rgba = sample_level(texture, sampler, np.int64(0), texture.mag_linear != 0, u, v)
    while k != _NO_LEVEL:
        is_level = levels == vec.i32(k)
        rgba = select4(is_level, _sample_between(texture, sampler, k, t, u, v), rgba)
        levels = vec.select(is_level, no_level, levels)
        k = vec.minimum_of(levels)
    return rgba


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
