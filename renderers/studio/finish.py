"""From what was gathered of a picture's layers to its bytes."""

from __future__ import annotations

import numpy as np
from numba import njit

from renderers import simd as vec
from renderers.jit import kernel
from renderers.pointers import f32_at, u8_at
from renderers.studio.tonemap import srgb_byte


@njit(nogil=True, error_model="numpy", forceinline=True)
def _channel(layers, at, k, rest, behind, cells):  # type: ignore[no-untyped-def]
    """One channel of eight pixels."""
    return srgb_byte(vec.gather(layers, at + vec.i32(k)) + rest * vec.f32(behind[k]), cells)


@kernel("void(int64, int64, int64, int64, int64, int64, int64)")
def finish_rows(layers_at, behind_at, cells, width, row_begin, row_end, color_at):  # type: ignore[no-untyped-def]
    """Puts the background behind what was gathered, and encodes as sRGB.

    Args:
        layers_at: address of (H, width, 4) float32: linear colour times coverage, and coverage.
        behind_at: address of (3,) float32, the linear background.
        cells: address of ``SRGB_CELLS``.
        color_at: address of (H, width, 3) uint8.
    """
    behind = f32_at(behind_at)
    own_line = np.empty(3 * (width + vec.LANES) + 4, np.uint8)
    line = u8_at(np.int64(own_line.ctypes.data))
    lane, four, last = vec.iota(), vec.i32(4), vec.i32(width - 1)
    zero, one, least = vec.f32(0.0), vec.f32(1.0), vec.f32(1e-6)
    for y in range(row_begin, row_end):
        layers = f32_at(layers_at + 16 * y * width)
        for x in range(0, width, vec.LANES):
            at = vec.least(vec.i32(x) + lane, last) * four
            rest = one - vec.gather(layers, at + vec.i32(3))
            rest = vec.select(rest > least, rest, zero)
            red = _channel(layers, at, 0, rest, behind, cells)
            green = _channel(layers, at, 1, rest, behind, cells)
            blue = _channel(layers, at, 2, rest, behind, cells)
            vec.store_rgb(line, 3 * x, red | (green << vec.i32(8)) | (blue << vec.i32(16)))
        color = u8_at(color_at + 3 * y * width)
        for k in range(3 * width):
            color[k] = line[k]
    own_line[0] = 0  # the pointer above does not keep the array alive
