"""Finishing rows of the look ``studio``: background and sRGB bytes."""

from __future__ import annotations

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.pointers import f32_at, i64_at, u8_at
from renderers.shading.studio.layout import F_BEHIND, F_CELLS, F_COLOR, line_in_kernel
from renderers.shading.studio.tonemap import srgb_byte


@device_function
def finish_row(layers, line, behind, cells, width, spare, color_at):
    """Blend a row's layers over the background and encode it as sRGB.

    Args:
        layers: pointer to four lines of ``line`` float32: linear colour times coverage, and coverage.
        behind: pointer to the linear background.
        cells: address of ``SRGB_CELLS``.
        spare: pointer to 3 line + 4 bytes.
        color_at: address of the row of the image, (width, 3) uint8.
    """
    zero, one, least, eight = vec.f32(0.0), vec.f32(1.0), vec.f32(1e-6), vec.i32(8)
    for x in range(0, width, vec.LANES):
        rest = one - vec.load(layers, 3 * line + x)
        rest = vec.select(rest > least, rest, zero)
        red = srgb_byte(vec.load(layers, x) + rest * vec.f32(behind[0]), cells)
        green = srgb_byte(vec.load(layers, line + x) + rest * vec.f32(behind[1]), cells)
        blue = srgb_byte(vec.load(layers, 2 * line + x) + rest * vec.f32(behind[2]), cells)
        vec.store_rgb(spare, 3 * x, red | (green << eight) | (blue << (eight + eight)))
    color = u8_at(color_at)
    for k in range(3 * width):
        color[k] = spare[k]


@kernel("void(int64, int64, int64, int64, int64)")
def finish_rows(layers_at, finish_at, width, row_begin, row_end):
    """Finish the rows ``row_begin .. row_end - 1``.

    Args:
        layers_at: address of (H, 4, line_of(width)) float32. finish_at: address of F_COLUMNS int64.
    """
    line, finish = line_in_kernel(width), i64_at(finish_at)
    own_bytes = np.empty(3 * line + 4, np.uint8)
    spare = u8_at(np.int64(own_bytes.ctypes.data))
    for y in range(row_begin, row_end):
        color_at = finish[F_COLOR] + 3 * y * width
        finish_row(
            f32_at(layers_at + 16 * y * line), line, f32_at(finish[F_BEHIND]), finish[F_CELLS], width, spare, color_at
        )
    own_bytes[0] = 0  # the pointer above does not keep the array alive
