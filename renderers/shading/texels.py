"""Texels of mip levels, eight pixels at a time: wrap modes and bilinear interpolation.

``locate`` stores which texels a pixel reads, two pairs of neighbours, and ``read_texels`` interpolates between them.
They are called in separate loops over the pixels, so that the processor overlaps the loads of many pixels. The head of
``textures`` shows where mip levels are in memory. The four texels a to d, and the weights tx and ty::

    upper offset ->  [a b]       a + tx (b - a)
                                                > + ty (..)
    lower offset ->  [c d]       c + tx (d - c)

A texture coordinate of 0 is the left or upper border of the image, 1 the other one. Coordinates in texels are those
times the size of the level. Texel i of a row or column has its centre at i + 0.5.
"""

from typing import Final, NamedTuple

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import F32, I32, I64, Pointer
from renderers.compiler.pointers import advance
from renderers.compiler.simd import F32x8, F32x8x4, I32x8, Mask8
from renderers.shading.layout import ROW_STRIDE, PartPixels, ShadingTexture
from renderers.shading.texture_table import WRAP_CLAMP, WRAP_MIRROR, WRAP_REPEAT

_MAX_COORDINATE: Final = np.float32(1e9)
"""Larger coordinates, which have no fraction in float32, and NaN become 0."""
_INV_255: Final = np.float32(1.0 / 255.0)


class TextureFields(NamedTuple):
    """Copies of a ShadingTexture's fields in local variables: kernels would load a struct's again after every store."""

    texels: Pointer[I32]
    stride: I64
    last_level: I64
    width: I64
    height: I64
    wrap_s: I64
    wrap_t: I64
    srgb: bool
    """True: colour channels are decoded by ``linear_from_byte``."""
    linear_from_byte: Pointer[F32]
    """Pointer to ``color.LINEAR_FROM_BYTE``, (256,) float32."""


@inlined
def texture_fields(texture: ShadingTexture, linear_from_byte: Pointer[F32]) -> TextureFields:
    """Return copies of a texture's fields."""
    return TextureFields(
        texels=texture.texels,
        stride=texture.stride,
        last_level=texture.last_level,
        width=texture.width,
        height=texture.height,
        wrap_s=texture.wrap_s,
        wrap_t=texture.wrap_t,
        srgb=texture.srgb != 0,
        linear_from_byte=linear_from_byte,
    )


@inlined
def level_size(size: I64, level: I32x8) -> I32x8:
    """Return width or height of mip levels in texels; ``size``: that of the first level."""
    return vec.maximum(vec.i32(size) >> level, vec.i32(1))


@inlined
def located_rows(pixels: PartPixels, level_offset: I64) -> tuple[Pointer[I32], Pointer[F32]]:
    """Return two rows of ``texel_offsets`` and two of ``texel_weights``, which ``locate`` fills.

    With ``level_offset`` 0 they are those for each pixel's mip level, with 1 those for the next level.
    """
    first = 2 * ROW_STRIDE * level_offset
    return advance(pixels.texel_offsets, first), advance(pixels.texel_weights, first)


@inlined
def _level_row(height: I32x8, level: I32x8) -> I32x8:
    """Return the first row of mip levels in memory, which ``textures.level_row`` explains; ``height``: of level 0."""
    return vec.maximum(height - ((height + height) >> level) + level, vec.i32(0))


@inlined
def wrapped(coordinate: F32x8, wrap: I64) -> F32x8:
    """Return texture coordinates in one period of the WRAP_ mode; ``_texel_columns`` and ``_texel_rows`` do the rest.

    ``WRAP_REPEAT``: 0 <= result < 1. ``WRAP_MIRROR``: 0 <= result <= 2, the image and its mirror image. ``WRAP_CLAMP``:
    -1 <= result <= 2, so that texel indices fit int32; all indices beyond a border will read the border's texel.
    """
    zero, one = vec.f32(0.0), vec.f32(1.0)
    coordinate = vec.select(vec.absolute(coordinate) < vec.f32(_MAX_COORDINATE), coordinate, zero)
    if wrap == WRAP_REPEAT:
        coordinate = coordinate - vec.floor(coordinate)
        return vec.select(coordinate < one, coordinate, zero)  # a tiny negative number + 1 is rounded to 1
    if wrap == WRAP_CLAMP:
        return vec.minimum(vec.maximum(coordinate, -one), vec.f32(2.0))
    return coordinate - vec.f32(2.0) * vec.floor(vec.f32(0.5) * coordinate)


@inlined
def _clamped(index: I32x8, size: I32x8) -> I32x8:
    """Return texel indices, clamped to 0 <= texel < size."""
    return vec.minimum(vec.maximum(index, vec.i32(0)), size - vec.i32(1))


@inlined
def _texel_columns(s: F32x8, wrap: I64, width: I32x8, is_linear: Mask8) -> tuple[I32x8, F32x8]:
    """Return the left one of the two neighbouring columns that a pixel reads, and the weight of the right one.

    The right column is the next one in memory. The weight is 0 where that is not the neighbour. ``s`` is the position
    in texels from the centre of column 0 (``is_linear``), else from its left border.
    """
    left, zero = vec.floor(s), vec.f32(0.0)
    column, weight = vec.to_i32(left), vec.select(is_linear, s - left, zero)
    if wrap == WRAP_REPEAT:
        # Column -1 is the last one. It is followed in memory by a copy of the first one, see ``textures``.
        return vec.select(column < vec.i32(0), column + width, column), weight
    last = width - vec.i32(1)
    if wrap == WRAP_MIRROR:
        # Column i >= width is the mirror image of column 2 width - 1 - i. So the pair lies the other way round in
        # memory: column + 1 is the left one, 2 width - 2 - column, and the weight is that of the other one.
        is_mirrored = column >= width
        column = vec.select(is_mirrored, last + last - column, column)
        weight = vec.select(is_mirrored, vec.f32(1.0) - weight, weight)
    # Where one column of the pair is beyond a border, both are the border's.
    weight = vec.select((column >= vec.i32(0)) & (column < last), weight, zero)
    return _clamped(column, width), weight


@inlined
def _texel_rows(t: F32x8, wrap: I64, height: I32x8, is_linear: Mask8) -> tuple[I32x8, I32x8, F32x8]:
    """Return which two rows a pixel reads, and the weight of the second; ``t``: as ``s`` of ``_texel_columns``."""
    upper = vec.floor(t)
    row, weight = vec.to_i32(upper), vec.select(is_linear, t - upper, vec.f32(0.0))
    zero, one, next_row = vec.i32(0), vec.i32(1), row + vec.i32(1)
    if wrap == WRAP_REPEAT:
        row = vec.select(row < zero, row + height, row)
        return row, vec.select(next_row < height, next_row, zero), weight
    if wrap == WRAP_MIRROR:
        # Row i >= height is the mirror image of row 2 height - 1 - i. Row -1, and row 2 height of the next period, are
        # both images of row 0. They are -1 after this, and ``_clamped`` makes them 0.
        row = vec.select(row < height, row, height + height - one - row)
        next_row = vec.select(next_row < height, next_row, height + height - one - next_row)
    return _clamped(row, height), _clamped(next_row, height), weight


@inlined
def locate(
    fields: TextureFields,
    offsets: Pointer[I32],
    weights: Pointer[F32],
    pixel: I64,
    level: I32x8,
    is_linear: Mask8,
    u: F32x8,
    v: F32x8,
) -> None:
    """Store which texels eight pixels read, and the weights of the right and the lower ones.

    Where ``is_linear`` is set, they are the four nearest texels; elsewhere the texel that contains (u, v), ``wrapped``.
    """
    # Size of the level, and where it begins in memory. Levels from 1 on are right of level 0 and of its copied column.
    width, height = vec.i32(fields.width), vec.i32(fields.height)
    level_row, level_column = vec.i32(0), vec.i32(0)
    if fields.last_level > 0:
        level_row = _level_row(height, level)
        level_column = vec.select(level > vec.i32(0), width + vec.i32(1), level_column)
        width, height = level_size(fields.width, level), level_size(fields.height, level)
    half = vec.select(is_linear, vec.f32(0.5), vec.f32(0.0))  # distance from a texel's border to its centre
    s, t = u * vec.to_f32(width) - half, v * vec.to_f32(height) - half
    column, tx = _texel_columns(s, fields.wrap_s, width, is_linear)
    row, next_row, ty = _texel_rows(t, fields.wrap_t, height, is_linear)
    column, stride = column + level_column, vec.i32(fields.stride)
    vec.store(offsets, pixel, (level_row + row) * stride + column)
    vec.store(offsets, ROW_STRIDE + pixel, (level_row + next_row) * stride + column)
    vec.store(weights, pixel, tx)
    vec.store(weights, ROW_STRIDE + pixel, ty)


@inlined
def _bilinear(a: F32x8, b: F32x8, c: F32x8, d: F32x8, tx: F32x8, ty: F32x8) -> F32x8:
    """Interpolate between four values: a and b above c and d. The result is exact if all are equal."""
    upper, lower = a + tx * (b - a), c + tx * (d - c)
    return upper + ty * (lower - upper)


@inlined
def _channel(texel: I32x8, k: I64) -> I32x8:
    """Return channel ``k`` of eight texels, 0 .. 255."""
    return (texel >> vec.i32(8 * k)) & vec.i32(255)


@inlined
def _bilinear_channel(a: I32x8, b: I32x8, c: I32x8, d: I32x8, tx: F32x8, ty: F32x8, k: I64) -> F32x8:
    """Return channel ``k``, stored byte / 255, between four texels."""
    upper = vec.to_f32(_channel(a, k)), vec.to_f32(_channel(b, k))
    lower = vec.to_f32(_channel(c, k)), vec.to_f32(_channel(d, k))
    # Scaled after interpolation: one product in place of four.
    return _bilinear(upper[0], upper[1], lower[0], lower[1], tx, ty) * vec.f32(_INV_255)


@inlined
def read_texels(
    fields: TextureFields, offsets: Pointer[I32], weights: Pointer[F32], pixel: I64, with_alpha: bool
) -> F32x8x4:
    """Return RGBA, 0 .. 1, of eight pixels from the texels of ``locate``; A is 1 without ``with_alpha``."""
    tx, ty = vec.load(weights, pixel), vec.load(weights, ROW_STRIDE + pixel)
    alpha = vec.f32(1.0)
    if fields.srgb:
        # RGB of the left texels, then of the right ones.
        upper = vec.decode_pairs(fields.linear_from_byte, fields.texels, offsets, pixel)
        lower = vec.decode_pairs(fields.linear_from_byte, fields.texels, offsets, ROW_STRIDE + pixel)
        red = _bilinear(upper[0], upper[3], lower[0], lower[3], tx, ty)
        green = _bilinear(upper[1], upper[4], lower[1], lower[4], tx, ty)
        blue = _bilinear(upper[2], upper[5], lower[2], lower[5], tx, ty)
    if with_alpha or not fields.srgb:
        a, b = vec.load_pairs(fields.texels, offsets, pixel)
        c, d = vec.load_pairs(fields.texels, offsets, ROW_STRIDE + pixel)
        if not fields.srgb:
            red = _bilinear_channel(a, b, c, d, tx, ty, 0)
            green = _bilinear_channel(a, b, c, d, tx, ty, 1)
            blue = _bilinear_channel(a, b, c, d, tx, ty, 2)
        if with_alpha:
            alpha = _bilinear_channel(a, b, c, d, tx, ty, 3)
    return red, green, blue, alpha
