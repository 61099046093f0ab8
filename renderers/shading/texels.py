"""Texels of mip levels, eight pixels at a time: wrap modes and bilinear interpolation.

``locate`` stores which texels a pixel reads, two pairs of neighbours, and ``read_texels`` interpolates between them.
They are called in separate loops over the pixels, so that the processor overlaps the loads of many pixels::

    upper offset ->  [a b]       a + tx (b - a)
                                                > + ty (..)
    lower offset ->  [c d]       c + tx (d - c)

A texture coordinate of 0 is the left or upper border of the image, 1 the other one. Coordinates in texels are those
times the size of the level; texel i has its centre at i + 0.5, and is to the right of or below texel i - 1.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import F32, I32, I64, Pointer
from renderers.compiler.pointers import advance
from renderers.compiler.simd import F32x8, F32x8x4, I32x8, Mask8
from renderers.shading.layout import ROW_STRIDE, ShadedPixels, ShadingTexture
from renderers.shading.texture_table import WRAP_CLAMP, WRAP_MIRROR, WRAP_REPEAT

_MAX_COORDINATE: Final = np.float32(1e9)
"""Larger coordinates and NaN become 0, since float32 has no fractions of such numbers."""
_INV_255: Final = np.float32(1.0 / 255.0)


class TextureView(NamedTuple):
    """Fields of a texture that sampling reads, as local variables.

    Kernels would load a struct's fields again after every store.
    """

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
def texture_view(texture: ShadingTexture, linear_from_byte: Pointer[F32]) -> TextureView:
    """Return the TextureView of a ShadingTexture."""
    return TextureView(
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
    """Return width or height of mip levels in texels.

    Args:
        size: that of the first level.
    """
    return vec.maximum(vec.i32(size) >> level, vec.i32(1))


@inlined
def texels_of_level(pixels: ShadedPixels, k: I64) -> tuple[Pointer[I32], Pointer[F32]]:
    """Return the rows of ShadedPixels for the texels of each pixel's mip level (``k`` = 0) or of the next one (1).

    Returns:
        offsets: pointer to two rows of ``texel_offsets``. weights: pointer to two rows of ``texel_weights``.
    """
    return advance(pixels.texel_offsets, 2 * ROW_STRIDE * k), advance(pixels.texel_weights, 2 * ROW_STRIDE * k)


@inlined
def _level_row(height: I32x8, level: I32x8) -> I32x8:
    """``textures.level_row`` of i32x8."""
    return vec.maximum(height - (height + height >> level) + level, vec.i32(0))


@inlined
def wrapped(coordinate: F32x8, wrap: I64) -> F32x8:
    """Return an f32x8 of texture coordinates in one period, which ``_texel_columns`` and ``_texel_rows`` fold further.

    With ``WRAP_REPEAT`` it is 0 .. 1, without 1, and with ``WRAP_MIRROR`` 0 .. 2. With ``WRAP_CLAMP`` it is -1 .. 2,
    since anything beyond a border reads the border.

    Args:
        wrap: WRAP_ constant of texture_table.
    """
    zero, one = vec.f32(0.0), vec.f32(1.0)
    coordinate = vec.select(vec.absolute(coordinate) < vec.f32(_MAX_COORDINATE), coordinate, zero)
    if wrap == WRAP_REPEAT:
        coordinate = coordinate - vec.floor(coordinate)
        return vec.select(coordinate < one, coordinate, zero)  # 1: a tiny negative number, rounded
    if wrap == WRAP_CLAMP:
        return vec.minimum(vec.maximum(coordinate, -one), vec.f32(2.0))
    return coordinate - vec.f32(2.0) * vec.floor(vec.f32(0.5) * coordinate)


@inlined
def _clamped(index: I32x8, size: I32x8) -> I32x8:
    """Return texel indices, clamped to 0 <= texel < size."""
    return vec.minimum(vec.maximum(index, vec.i32(0)), size - vec.i32(1))


@inlined
def _texel_columns(s: F32x8, wrap: I64, width: I32x8, is_linear: Mask8) -> tuple[I32x8, F32x8]:
    """Return which column a pixel reads, together with the column after it in memory.

    Args:
        s: position in texels from the centre of column 0 (``is_linear``), else from its left border.
        wrap: WRAP_ constant of texture_table.
        width: of the mip level.

    Returns:
        column: 0 <= column < width.
        weight: of the column after it.
    """
    left, zero = vec.floor(s), vec.f32(0.0)
    column, weight = vec.to_i32(left), vec.select(is_linear, s - left, zero)
    if wrap == WRAP_REPEAT:
        # -1 is the last column. After the last one, the first one is repeated in memory, see textures.
        return vec.select(column < vec.i32(0), column + width, column), weight
    last = width - vec.i32(1)
    if wrap == WRAP_MIRROR:
        # The columns i and i + 1 mirror to 2 width - 1 - i and 2 width - 2 - i, of which the second is the left one.
        is_mirrored = column >= width
        column = vec.select(is_mirrored, last + last - column, column)
        weight = vec.select(is_mirrored, vec.f32(1.0) - weight, weight)
    # Beyond a border, both columns are that of the border.
    weight = vec.select((column >= vec.i32(0)) & (column < last), weight, zero)
    return _clamped(column, width), weight


@inlined
def _texel_rows(t: F32x8, wrap: I64, height: I32x8, is_linear: Mask8) -> tuple[I32x8, I32x8, F32x8]:
    """Return which two rows a pixel reads, 0 <= row < height, and the weight of the second.

    Args:
        t, wrap, height, is_linear: as in ``_texel_columns``.
    """
    upper = vec.floor(t)
    row, weight = vec.to_i32(upper), vec.select(is_linear, t - upper, vec.f32(0.0))
    zero, one, next_row = vec.i32(0), vec.i32(1), row + vec.i32(1)
    if wrap == WRAP_REPEAT:
        row = vec.select(row < zero, row + height, row)
        return row, vec.select(next_row < height, next_row, zero), weight
    if wrap == WRAP_MIRROR:
        # Row -1 mirrors to row 0. Row 2 height is row 0 of the next period. Both become 0 below.
        row = vec.select(row < height, row, height + height - one - row)
        next_row = vec.select(next_row < height, next_row, height + height - one - next_row)
    return _clamped(row, height), _clamped(next_row, height), weight


@inlined
def locate(
    view: TextureView,
    offsets: Pointer[I32],
    weights: Pointer[F32],
    x: I64,
    level: I32x8,
    is_linear: Mask8,
    u: F32x8,
    v: F32x8,
) -> None:
    """Store which texels the pixels x .. x + 8 of a part read, and the weights of the right and the lower ones.

    Args:
        offsets, weights: from ``texels_of_level``.
        level: mip levels.
        is_linear: m8; set: interpolate between the four nearest texels; else read the texel that contains (u, v).
        u, v: texture coordinates, ``wrapped``.
    """
    width, height = vec.i32(view.width), vec.i32(view.height)
    first_row, first_column = vec.i32(0), vec.i32(0)
    if view.last_level > 0:
        first_row = _level_row(height, level)
        first_column = vec.select(level > vec.i32(0), width + vec.i32(1), first_column)
        width, height = level_size(view.width, level), level_size(view.height, level)
    half = vec.select(is_linear, vec.f32(0.5), vec.f32(0.0))
    s = u * vec.to_f32(width) - half
    t = v * vec.to_f32(height) - half
    column, tx = _texel_columns(s, view.wrap_s, width, is_linear)
    row, next_row, ty = _texel_rows(t, view.wrap_t, height, is_linear)
    column, stride = column + first_column, vec.i32(view.stride)
    vec.store(offsets, x, (first_row + row) * stride + column)
    vec.store(offsets, ROW_STRIDE + x, (first_row + next_row) * stride + column)
    vec.store(weights, x, tx)
    vec.store(weights, ROW_STRIDE + x, ty)


@inlined
def _bilinear(a: F32x8, b: F32x8, c: F32x8, d: F32x8, tx: F32x8, ty: F32x8) -> F32x8:
    """Interpolate between four values: a and b above c and d. The result is exact if all are equal.

    Args:
        tx, ty: weights of the right and of the lower values.
    """
    upper, lower = a + tx * (b - a), c + tx * (d - c)
    return upper + ty * (lower - upper)


@inlined
def _bytes(texel: I32x8, k: I64) -> I32x8:
    """Return channel ``k`` of eight texels, 0 .. 255."""
    return (texel >> vec.i32(8 * k)) & vec.i32(255)


@inlined
def _unit_channel(a: I32x8, b: I32x8, c: I32x8, d: I32x8, tx: F32x8, ty: F32x8, k: I64) -> F32x8:
    """Return channel ``k``, stored byte / 255, between four texels."""
    upper = vec.to_f32(_bytes(a, k)), vec.to_f32(_bytes(b, k))
    lower = vec.to_f32(_bytes(c, k)), vec.to_f32(_bytes(d, k))
    # Scaled after interpolation: one product in place of four.
    return _bilinear(upper[0], upper[1], lower[0], lower[1], tx, ty) * vec.f32(_INV_255)


@inlined
def read_texels(view: TextureView, offsets: Pointer[I32], weights: Pointer[F32], x: I64, alpha: bool) -> F32x8x4:
    """Return RGBA, 0 .. 1, of the pixels x .. x + 8 of a part from the texels that ``locate`` has stored.

    Args:
        view, offsets, weights: as in ``locate``.
        alpha: True: read alpha. Otherwise it is 1.
    """
    tx, ty = vec.load(weights, x), vec.load(weights, ROW_STRIDE + x)
    if view.srgb:
        upper = vec.decode_pairs(view.linear_from_byte, view.texels, offsets, x)
        lower = vec.decode_pairs(view.linear_from_byte, view.texels, offsets, ROW_STRIDE + x)
        red = _bilinear(upper[0], upper[3], lower[0], lower[3], tx, ty)
        green = _bilinear(upper[1], upper[4], lower[1], lower[4], tx, ty)
        blue = _bilinear(upper[2], upper[5], lower[2], lower[5], tx, ty)
        if not alpha:
            return red, green, blue, vec.f32(1.0)
    a, b = vec.load_pairs(view.texels, offsets, x)
    c, d = vec.load_pairs(view.texels, offsets, ROW_STRIDE + x)
    if not view.srgb:
        red = _unit_channel(a, b, c, d, tx, ty, 0)
        green = _unit_channel(a, b, c, d, tx, ty, 1)
        blue = _unit_channel(a, b, c, d, tx, ty, 2)
    return red, green, blue, _unit_channel(a, b, c, d, tx, ty, 3) if alpha else vec.f32(1.0)
