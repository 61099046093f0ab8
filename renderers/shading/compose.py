"""From shaded pixels to the picture: bytes, translucent layers, background."""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit

from renderers import simd as vec
from renderers.pointers import f32_at, u8_at
from renderers.shading.layout import A_BASE, S_BACKGROUND, S_COLOR, S_GAMMA, S_GATHERED, S_MODE, S_PBR, S_WIDTH
from renderers.shading.materials import ALPHA_BLEND, ALPHA_MASK
from renderers.shading.transfer import GAMMA, gamma_byte, plain_byte

DIRECT: Final = 0
"""Write the picture."""
GATHER: Final = 1
"""Add a translucent layer behind those gathered so far."""
UNDER: Final = 2
"""Write the picture beneath the gathered layers."""

_ZERO: Final = np.float32(0.0)
_ONE: Final = np.float32(1.0)
_INVERSE_GAMMA: Final = 1.0 / GAMMA


@njit(nogil=True, error_model="numpy", forceinline=True)
def packed(r, g, b):  # type: ignore[no-untyped-def]
    """Eight colours (f32x8 each) that are stored as they are, as i32x8: red in the lowest byte, then green, blue."""
    return plain_byte(r) | (plain_byte(g) << vec.i32(8)) | (plain_byte(b) << vec.i32(16))


@njit(nogil=True, error_model="numpy", forceinline=True)
def write(job, pbr, line, x, r, g, b):  # type: ignore[no-untyped-def]
    """Eight shaded pixels (f32x8 each), packed, to the row that ``line`` points to."""
    if pbr:
        cells = job[S_GAMMA]
        red, green, blue = gamma_byte(r, cells), gamma_byte(g, cells), gamma_byte(b, cells)
        vec.store(line, x, red | (green << vec.i32(8)) | (blue << vec.i32(16)))
    else:
        vec.store(line, x, packed(r, g, b))


@njit(nogil=True, error_model="numpy")
def _shown(c, pbr):  # type: ignore[no-untyped-def]
    """What ``write`` rounds to a byte, 0 .. 1."""
    if not (c > _ZERO):
        return _ZERO
    c = min(c, _ONE)
    return np.float32(np.float64(c) ** _INVERSE_GAMMA) if pbr else c


@njit(nogil=True, error_model="numpy")
def _one_byte(c):  # type: ignore[no-untyped-def]
    """As ``plain_byte`` for a scalar that is a number."""
    return np.int32(min(max(c, _ZERO), _ONE) * np.float32(255.0) + np.float32(0.5))


@njit(nogil=True, error_model="numpy")
def gather(job, alpha_mode, cutoff, y, begin, end, rows, stride):  # type: ignore[no-untyped-def]
    """Adds a segment behind the layers gathered so far, in the space of the stored picture, as VTK does."""
    pbr = job[S_PBR] != 0
    gathered = f32_at(job[S_GATHERED] + 16 * y * job[S_WIDTH])
    for x in range(begin, end):
        through = gathered[4 * x + 3]
        alpha = rows[(A_BASE + 3) * stride + x]
        if alpha_mode == ALPHA_BLEND:
            alpha = min(max(alpha, _ZERO), _ONE) if alpha == alpha else _ONE
        elif alpha_mode == ALPHA_MASK:
            alpha = _ZERO if alpha < cutoff else _ONE
        else:
            alpha = _ONE
        if alpha > _ZERO and through > _ZERO:
            for k in range(3):
                gathered[4 * x + k] += through * alpha * _shown(rows[(A_BASE + k) * stride + x], pbr)
            gathered[4 * x + 3] = through * (_ONE - alpha)


@njit(nogil=True, error_model="numpy")
def write_under(job, y, begin, end, rows, stride, line):  # type: ignore[no-untyped-def]
    """A segment beneath the gathered layers."""
    pbr = job[S_PBR] != 0
    gathered = f32_at(job[S_GATHERED] + 16 * y * job[S_WIDTH])
    for x in range(begin, end):
        through = gathered[4 * x + 3]
        pixel = np.int32(0)
        for k in range(3):
            shown = _shown(rows[(A_BASE + k) * stride + x], pbr)
            pixel |= _one_byte(gathered[4 * x + k] + through * shown) << np.int32(8 * k)
        line[x] = pixel


@njit(nogil=True, error_model="numpy")
def write_background(job, y, begin, end, line):  # type: ignore[no-untyped-def]
    """Pixels that see nothing."""
    background = job[S_BACKGROUND]
    if job[S_MODE] == DIRECT:
        pixels = vec.i32(background)
        for x in range(begin, end, vec.LANES):
            vec.store(line, x, pixels)
    elif job[S_MODE] == UNDER:
        gathered = f32_at(job[S_GATHERED] + 16 * y * job[S_WIDTH])
        for x in range(begin, end):
            pixel = np.int32(0)
            for k in range(3):
                behind = np.float32((background >> (8 * k)) & 255) / np.float32(255.0)
                pixel |= _one_byte(gathered[4 * x + k] + gathered[4 * x + 3] * behind) << np.int32(8 * k)
            line[x] = pixel


@njit(nogil=True, error_model="numpy")
def put_line(job, y, width, line):  # type: ignore[no-untyped-def]
    """The first ``width`` packed pixels of a finished row to the bytes of the picture."""
    color = u8_at(job[S_COLOR] + 3 * y * job[S_WIDTH])
    # What is written behind eight pixels, up to four bytes, must be overwritten by the next ones of the same row.
    whole = max(width - 2, 0) // vec.LANES * vec.LANES
    for x in range(0, whole, vec.LANES):
        vec.store_rgb(color, 3 * x, vec.load(line, x))
    for x in range(whole, width):
        for k in range(3):
            color[3 * x + k] = line[x] >> (8 * k)
