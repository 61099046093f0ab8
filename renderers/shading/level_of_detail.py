"""Selects the mip levels of minified textures, as OpenGL does (OpenGL 4.6, 8.14), eight pixels at a time."""

import math
from typing import Final

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.simd import F32x8, I32x8, Mask8
from renderers.shading.layout import ShadingTexture
from renderers.shading.texture_table import MIPS_NEAREST, MIPS_NONE

MAGNIFIED: Final = -1
"""Mip level of magnified pixels, which read level 0."""


@inlined
def is_minified(texture: ShadingTexture, squared_side: F32x8) -> Mask8:
    """Return a mask of the pixels that see more than a texel of level 0; ``squared_side``: longer side of what they
    see."""
    # With a linear magnifying and a nearest minifying filter, minification begins at half a level (OpenGL 4.6, 8.14).
    begins_late = texture.mag_linear != 0 and texture.min_linear == 0 and texture.mip_mode != MIPS_NONE
    return squared_side > vec.f32(2.0 if begins_late else 1.0)


@inlined
def mip_levels(texture: ShadingTexture, squared_side: F32x8) -> tuple[I32x8, F32x8]:
    """Return the mip levels that the sampler selects for eight minified pixels, and the next ones' weights, 0 .. 1."""
    level, next_level_weight = vec.i32(0), vec.f32(0.0)
    if texture.mip_mode != MIPS_NONE:
        # log2 of the side, the level whose texels are as large as the footprint.
        detail = vec.minimum(_half_log2(squared_side), vec.f32(texture.last_level))
        if texture.mip_mode == MIPS_NEAREST:
            nearest = vec.to_i32(vec.ceil(detail + vec.f32(0.5))) - vec.i32(1)
            level = vec.minimum(nearest, vec.i32(texture.last_level))
        else:
            level = vec.to_i32(detail)
            next_level_weight = detail - vec.to_f32(level)
    return level, next_level_weight


@inlined
def _half_log2(x: F32x8) -> F32x8:
    """Return ``log2(x) / 2`` of an f32x8 >= 1, within 1e-6; 64 or more for infinity and NaN.

    x = 2^exponent (1 + fraction), so that log2 x = exponent + ln(1 + fraction) / ln 2. With
    t = fraction / (fraction + 2), ln(1 + fraction) = 2 artanh t = 2 (t + t^3 / 3 + t^5 / 5 + ...). The C library's
    ``log`` is not used, since its last bit differs between machines.
    """
    bits = vec.float_bits(x)
    exponent = vec.to_f32((bits >> vec.i32(23)) - vec.i32(127))
    fraction = vec.to_f32(bits & vec.i32(0x7FFFFF)) * vec.f32(1.0 / (1 << 23))
    t = fraction / (fraction + vec.f32(2.0))
    t2 = t * t
    series = vec.f32(1.0 / 9.0) + t2 * vec.f32(1.0 / 11.0)
    series = vec.f32(0.2) + t2 * (vec.f32(1.0 / 7.0) + t2 * series)
    series = t * (vec.f32(1.0) + t2 * (vec.f32(1.0 / 3.0) + t2 * series))
    return vec.f32(0.5) * exponent + series * vec.f32(1.0 / math.log(2.0))
