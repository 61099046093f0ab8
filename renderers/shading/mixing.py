"""Pixels that are known to lie somewhere on a texture: divided by depth, located, fetched, mixed, lit and packed.

Each pass over the pixels has little to wait for within it, since a processor looks only some hundred instructions
ahead: in one pass, square root, division, cache lines and mixing would be waited for one after the other.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.linked import inlined, inner
from renderers.pointers import as_i32, i32_at
from renderers.shading.compose import packed
from renderers.shading.layout import A_BASE, A_DEPTH, A_PLACE, A_SQUARE, A_TOWARDS
from renderers.shading.materials import MF_BASE
from renderers.shading.sampling import at_place, coordinates_of, locate, reduced
from renderers.shading.textures import TI_ADDRESS, TI_HEIGHT, TI_STRIDE

PART: Final = 128
"""Pixels that are sampled at a time."""
LARGE: Final = 1 << 17
"""Texels of images that are fetched: half a megabyte, which is not in the nearer caches anyhow."""
WHOLE: Final = 32767.0
"""What stands for 1 where eight channels are mixed in 16 bits."""

# What is found for eight pixels, values of 4 bytes, in the rows from A_BASE on: their texels, and
F_INDEX: Final = vec.SQUARE_VALUES  # the number of the first texel
F_FX: Final = F_INDEX + vec.LANES  # the share of the second column, ...
F_FY: Final = F_FX + vec.LANES  # ... of the second row, and light: each twice, as ``_twice`` makes them
F_LIGHT: Final = F_FY + vec.LANES
FOUND: Final = F_LIGHT + vec.LANES


@inlined
def _twice(share):
    """Numbers of 0 to 1 in 15 bits, in both halves of an i32x8."""
    whole = vec.to_i32(share * vec.f32(WHOLE))
    return whole | (whole << vec.i32(16))


@inner
def _divide(lit, rows, stride, begin, end):
    """Depth of pixels instead of its reciprocal, and light instead of a square."""
    one = vec.f32(1.0)
    for x in range(begin, end, vec.LANES):
        total = vec.load(rows, A_DEPTH * stride + x)
        if lit:
            # One division for both. What has no direction has no place then either, and is black anywhere.
            length = vec.sqrt(vec.load(rows, A_SQUARE * stride + x))
            share = one / (total * length)
            vec.store(rows, A_DEPTH * stride + x, share * length)
            vec.store(rows, A_SQUARE * stride + x, vec.load(rows, A_TOWARDS * stride + x) * (share * total))
        else:
            vec.store(rows, A_DEPTH * stride + x, one / total)
            vec.store(rows, A_SQUARE * stride + x, one)


@inner
def _locate(integers, rows, stride, begin, end, found):
    """Put into ``found``, FOUND values for every eight pixels, where their texels are, the shares of these and the
    light. Behind them follow the columns of those eight of which some have texels that do not lie side by side.

    Returns:
        How many of these there are.
    """
    zero, one = vec.f32(0.0), vec.f32(1.0)
    fetched = integers[TI_HEIGHT] * integers[TI_STRIDE] > LARGE
    at, count = A_BASE * stride, np.int64(0)
    far = at + (end - begin + vec.LANES - 1) // vec.LANES * FOUND
    for x in range(begin, end, vec.LANES):
        share = vec.load(rows, A_DEPTH * stride + x)
        u, v = vec.load(rows, A_PLACE * stride + x) * share, vec.load(rows, (A_PLACE + 1) * stride + x) * share
        light = vec.least(vec.most(vec.load(rows, A_SQUARE * stride + x), zero), one)
        index, fx, fy, near = locate(integers, u, v)
        if vec.bits(near) != 255:  # in another of the image's repetitions, or at a border
            u0, v0 = coordinates_of(integers, u, v)
            u0, v0 = reduced(integers, u0, v0)
            u, v = vec.select(near, u, u0), vec.select(near, v, v0)
            index, fx, fy, near = locate(integers, u, v)
        if fetched:
            vec.prefetch_rows(i32_at(integers[TI_ADDRESS]), index, integers[TI_STRIDE])
        vec.store(rows, A_PLACE * stride + x, u)
        vec.store(rows, (A_PLACE + 1) * stride + x, v)
        vec.store(found, at + F_INDEX, vec.select(near, index, vec.i32(0)))
        vec.store(found, at + F_FX, _twice(fx))
        vec.store(found, at + F_FY, _twice(fy))
        vec.store(found, at + F_LIGHT, _twice(light))
        # What lies behind the end was left there by whatever was drawn before: it must not change how others are mixed.
        beyond = vec.iota() >= vec.i32(end - x)
        found[far + count] = x
        count += np.int64(vec.bits(near | beyond) != 255)
        at += FOUND
    return count


@inner
def _show_far(integers, mf, rows, stride, x, line):
    """Eight pixels of which some see texels on two borders of the image."""
    r, g, b, _ = at_place(integers, vec.load(rows, A_PLACE * stride + x), vec.load(rows, (A_PLACE + 1) * stride + x))
    light = vec.most(vec.load(rows, A_SQUARE * stride + x), vec.f32(0.0))
    r, g, b = (
        vec.f32(mf[MF_BASE]) * r * light,
        vec.f32(mf[MF_BASE + 1]) * g * light,
        vec.f32(mf[MF_BASE + 2]) * b * light,
    )
    vec.store(line, x, packed(r, g, b))


@inner
def show_located(integers, mf, lit, rows, stride, begin, end, line):
    """Pack the pixels ``begin .. end``, at most PART, of a material whose factors are within 0 .. 1.

    Args:
        rows: A_PLACE, A_DEPTH and, if ``lit``, A_SQUARE and A_TOWARDS are read; those and the ones from A_BASE on are
            overwritten, in all of them up to seven values behind ``end``.
        line: pointer to the row's packed pixels, the same.
    """
    found, texels = as_i32(rows), i32_at(integers[TI_ADDRESS])
    _divide(lit, rows, stride, begin, end)
    far = _locate(integers, rows, stride, begin, end, found)
    first, count = A_BASE * stride, (end - begin + vec.LANES - 1) // vec.LANES
    for k in range(count):
        at = first + FOUND * k
        vec.copy_squares(texels, integers[TI_STRIDE], rows, at + F_INDEX, at)
    red, green = np.int64(mf[MF_BASE] * WHOLE), np.int64(mf[MF_BASE + 1] * WHOLE)
    even = vec.iota() & vec.i32(1) < vec.i32(1)
    color = vec.select(even, vec.i32(red | (green << 16)), vec.i32(np.int64(mf[MF_BASE + 2] * WHOLE)))
    for k in range(count):
        at = first + FOUND * k
        fx, fy, light = vec.load(found, at + F_FX), vec.load(found, at + F_FY), vec.load(found, at + F_LIGHT)
        vec.store(line, begin + vec.LANES * k, vec.mix_squares(rows, at, fx, fy, light, color))
    at = first + FOUND * count
    for k in range(far):
        _show_far(integers, mf, rows, stride, np.int64(found[at + k]), line)
