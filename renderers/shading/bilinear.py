"""Pixels that are known to lie somewhere on a texture: located, fetched, mixed, lit and packed.

Each pass over the pixels has little to wait for within it, since a processor looks only some hundred instructions
ahead: in one pass, cache lines and mixing would be waited for one after the other.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inner
from renderers.compiler.pointers import as_i32, i32_at
from renderers.shading.layout import A_BASE, A_INDEX, A_PLACE, A_SHARE
from renderers.shading.materials import MF_BASE
from renderers.shading.output_merge import packed
from renderers.shading.sampling import FINE, at_place, coordinates_of, locate, parts, reduced
from renderers.shading.textures import TI_ADDRESS, TI_HEIGHT, TI_STRIDE

PART: Final = 128
"""Pixels that are sampled at a time."""
LARGE: Final = 1 << 17
"""Texels of images that are fetched: half a megabyte, which is not in the nearer caches anyhow."""
WIDE: Final = 1024
"""Values of a row from which on the next row's texels are fetched instead: a row then takes longer than fetching, and
what is fetched stays near until it is wanted."""
WHOLE: Final = 32767.0
"""What stands for 1 where eight channels are mixed in 16 bits."""


@inner
def _locate(integers, whole, stride, begin, end, far):
    """Put the numbers of the pixels' texels into the row A_INDEX, and behind value ``far`` of the rows the columns of
    those eight pixels of which some have texels that do not lie side by side.

    Returns:
        How many of these there are.
    """
    count = np.int64(0)
    at, below, to = A_PLACE * stride, (A_PLACE + 1) * stride, A_INDEX * stride
    fetched = integers[TI_HEIGHT] * integers[TI_STRIDE] > LARGE
    for x in range(begin, end, vec.LANES):
        index, beside = locate(integers, vec.load(whole, at + x), vec.load(whole, below + x))
        if vec.bits(beside) != 0:  # in another of the image's repetitions, or at a border
            index, apart = _moved(integers, whole, at + x, below + x, end - x)
            whole[far + count] = x
            count += np.int64(apart)
        if fetched and stride >= WIDE:  # as far from here as this is from what the row above has left
            ahead = index + (index - vec.load(whole, to + x))
            vec.prefetch_more_rows(i32_at(integers[TI_ADDRESS]), ahead, integers[TI_STRIDE])
        elif fetched:
            vec.prefetch_rows(i32_at(integers[TI_ADDRESS]), index, integers[TI_STRIDE])
        vec.store(whole, to + x, index)
    return count


@inner
def _moved(integers, whole, at, below, left):
    """``locate`` after places beside the image were moved into it; texels that are of no use have the number 0. And
    whether there are such among the first ``left``."""
    x, y = vec.load(whole, at), vec.load(whole, below)
    _, beside = locate(integers, x, y)
    u, v = coordinates_of(integers, x, y)
    u, v = reduced(integers, u, v)
    x, y = vec.select(beside, parts(u), x), vec.select(beside, parts(v), y)
    vec.store(whole, at, x)
    vec.store(whole, below, y)
    index, beside = locate(integers, x, y)
    # What lies behind the end was left there by whatever was drawn before: it must not change how others are mixed.
    within = vec.iota() < vec.i32(left)
    return vec.select(beside, vec.i32(0), index), vec.bits(beside & within) != 0


@inner
def _show_far(integers, mf, whole, stride, x, line):
    """Eight pixels of which some see texels on two borders of the image."""
    r, g, b, _ = at_place(integers, vec.load(whole, A_PLACE * stride + x), vec.load(whole, (A_PLACE + 1) * stride + x))
    light = vec.to_f32(vec.load(whole, A_SHARE * stride + x)) * vec.f32(1.0 / WHOLE)
    r, g, b = (
        vec.f32(mf[MF_BASE]) * r * light,
        vec.f32(mf[MF_BASE + 1]) * g * light,
        vec.f32(mf[MF_BASE + 2]) * b * light,
    )
    vec.store(line, x, packed(r, g, b))


@inner
def show_located(integers, mf, rows, stride, begin, end, line):
    """Pack the pixels ``begin .. end``, at most PART, of a material whose factors are within 0 .. 1.

    Args:
        rows: A_PLACE and A_SHARE are read; those, A_INDEX and the ones from A_BASE on are overwritten, in all of them
            up to seven values behind ``end``.
        line: pointer to the row's packed pixels, the same.
    """
    whole, texels = as_i32(rows), i32_at(integers[TI_ADDRESS])
    first, count = A_BASE * stride, (end - begin + vec.LANES - 1) // vec.LANES
    behind = first + vec.SQUARE_VALUES * count
    far = _locate(integers, whole, stride, begin, end, behind)
    for k in range(count):
        at = A_INDEX * stride + begin + vec.LANES * k
        vec.copy_squares(texels, integers[TI_STRIDE], rows, at, first + vec.SQUARE_VALUES * k)
    red, green = np.int64(mf[MF_BASE] * WHOLE), np.int64(mf[MF_BASE + 1] * WHOLE)
    even = vec.iota() & vec.i32(1) < vec.i32(1)
    color = vec.select(even, vec.i32(red | (green << 16)), vec.i32(np.int64(mf[MF_BASE + 2] * WHOLE)))
    share = vec.i32(FINE - 1)
    for k in range(count):
        x = begin + vec.LANES * k
        fx = vec.load(whole, A_PLACE * stride + x) & share
        fy = vec.load(whole, (A_PLACE + 1) * stride + x) & share
        light = vec.load(whole, A_SHARE * stride + x)
        vec.store(line, x, vec.mix_squares(rows, first + vec.SQUARE_VALUES * k, fx, fy, light, color))
    for k in range(far):
        _show_far(integers, mf, whole, stride, np.int64(whole[behind + k]), line)
