"""Tone curves, and the encoding of finished rows as sRGB bytes.

Khronos' "PBR Neutral" (specification 1.0, 2024): colours below 0.76 keep hue and saturation, brighter ones are
compressed towards white. "ACES": Stephen Hill's fit of the Academy's reference rendering and output transforms (sRGB to
AP1 with their saturation, one rational function, back), with the exposure of 1 / 0.6 that three.js, Babylon.js and the
Khronos sample viewer apply first. "None": values are clamped.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.color import linear_values_from_srgb
from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.pointers import address, f32_at, u8_at
from renderers.shading.studio.layout import OUTPUT, channel_values_in_kernel
from renderers.shading.vec3 import load3, saturate

TONES: Final = ("neutral", "aces", "none")
_NEUTRAL_START: Final = 0.8 - 0.04
"""Peak from which "PBR Neutral" compresses."""
_NEUTRAL_DESATURATION: Final = 0.15
_ACES_EXPOSURE: Final = 1.0 / 0.6

_LOWEST: Final = np.float32(2.0**-13)
"""First value of the table of cells, below the linear value of the lowest level above 0, 0.5 / 255 / 12.92."""
_LOWEST_BITS: Final = int(_LOWEST.view(np.int32))
_CELL_BITS: Final = 16
"""Low bits of the float32 within one cell: a cell is 2^-7 of an octave, narrower than any level."""

_output_at = OUTPUT.at


@inlined
def _neutral(r, g, b):
    """Apply Khronos' curve to linear colours. NaN becomes 0."""
    zero, one, start = vec.f32(0.0), vec.f32(1.0), vec.f32(_NEUTRAL_START)
    r, g, b = vec.maximum(r, zero), vec.maximum(g, zero), vec.maximum(b, zero)
    x = vec.minimum(r, vec.minimum(g, b))
    offset = vec.select(x < vec.f32(0.08), x - vec.f32(6.25) * x * x, vec.f32(0.04))
    r, g, b = r - offset, g - offset, b - offset
    peak = vec.maximum(r, vec.maximum(g, b))
    d = one - start
    new_peak = one - d * d / (peak + d - start)
    is_bright, is_white = peak >= start, peak >= vec.f32(1e30)
    w = one / (vec.f32(_NEUTRAL_DESATURATION) * (peak - new_peak) + one)
    scale = vec.select(is_bright, new_peak / peak * w, one)
    white_share = vec.select(is_bright, new_peak * (one - w), zero)
    return (
        vec.select(is_white, one, r * scale + white_share),
        vec.select(is_white, one, g * scale + white_share),
        vec.select(is_white, one, b * scale + white_share),
    )


@inlined
def _matrix_row(a, b, c, x, y, z):
    return vec.f32(a) * x + vec.f32(b) * y + vec.f32(c) * z


@inlined
def _aces_channel(v):
    numerator = v * (v + vec.f32(0.0245786)) - vec.f32(0.000090537)
    return numerator / (v * (vec.f32(0.983729) * v + vec.f32(0.4329510)) + vec.f32(0.238081))


@inlined
def _aces(r, g, b):
    """Apply Hill's fit to linear colours. NaN becomes 0."""
    # From 1e6 on, the curve is white to the last digit. Squares of much larger values would not be finite.
    zero, limit, exposure = vec.f32(0.0), vec.f32(1e6), vec.f32(_ACES_EXPOSURE)
    r = vec.minimum(vec.maximum(r, zero), limit) * exposure
    g = vec.minimum(vec.maximum(g, zero), limit) * exposure
    b = vec.minimum(vec.maximum(b, zero), limit) * exposure
    x = _aces_channel(_matrix_row(0.59719, 0.35458, 0.04823, r, g, b))
    y = _aces_channel(_matrix_row(0.07600, 0.90834, 0.01566, r, g, b))
    z = _aces_channel(_matrix_row(0.02840, 0.13383, 0.83777, r, g, b))
    return _saturate3(
        _matrix_row(1.60475, -0.53108, -0.07367, x, y, z),
        _matrix_row(-0.10208, 1.10813, -0.00605, x, y, z),
        _matrix_row(-0.00327, -0.07276, 1.07602, x, y, z),
    )


@inlined
def _saturate3(r, g, b):
    return saturate(r), saturate(g), saturate(b)


@device_function
def tone_map(tone, r, g, b):
    """Apply the tone curve ``TONES[tone]`` to linear colours (f32x8 each)."""
    if tone == 0:
        return _neutral(r, g, b)
    if tone == 1:
        return _aces(r, g, b)
    return _saturate3(r, g, b)


def _level_thresholds() -> NDArray[np.float32]:
    """Return (256,) float32: the least linear c for which ``round(255 srgb(c))`` is k; 0 for k = 0."""
    encoded = np.maximum(np.arange(256) - 0.5, 0.0) / 255.0
    thresholds: NDArray[np.float32] = linear_values_from_srgb(encoded).astype(np.float32)
    return thresholds


def _srgb_cells(thresholds: NDArray[np.float32]) -> NDArray[np.int32]:
    """Return (1665,) int32, one for each cell of 2^16 neighbouring float32 from _LOWEST to 1.

    A cell holds the level of its first value times 2^16, plus the number of its values at or above the next threshold.
    """
    cell_size = 1 << _CELL_BITS
    bits = np.arange(_LOWEST_BITS, int(np.float32(1.0).view(np.int32)) + cell_size, cell_size, dtype=np.int32)
    levels = np.searchsorted(thresholds, bits.view(np.float32), side="right") - 1
    next_cell_levels = np.searchsorted(thresholds, (bits + cell_size).view(np.float32), side="right") - 1
    assert (next_cell_levels - levels).max() <= 1
    next_threshold_bits = thresholds[np.minimum(levels + 1, 255)].view(np.int32)
    above = np.where(levels < 255, np.maximum(bits + cell_size - next_threshold_bits, 0), 0)
    cells: NDArray[np.int32] = ((levels << _CELL_BITS) + above).astype(np.int32)
    return cells


SRGB_CELLS: Final = _srgb_cells(_level_thresholds())


@inlined
def _srgb_byte(c, cells):
    """Return ``round(255 srgb(c))`` of an f32x8 as i32x8: 0 for NaN and below 0, 255 above 1.

    The table is exact for every float32. ``pow`` would differ between machines.

    Args:
        cells: pointer to ``SRGB_CELLS``.
    """
    c = vec.minimum(vec.maximum(c, vec.f32(_LOWEST)), vec.f32(1.0))
    bits = vec.float_bits(c) - vec.i32(_LOWEST_BITS)
    cell = vec.gather(cells, bits >> vec.i32(_CELL_BITS))
    return (cell + (bits & vec.i32((1 << _CELL_BITS) - 1))) >> vec.i32(_CELL_BITS)


@device_function
def finish_row(accumulated, output, y, width, rgb_bytes):
    """Blend an accumulated row over the background, and write row ``y`` of the image, encoded as sRGB.

    Args:
        accumulated: pointer to four channels of ``channel_values(width)`` float32: linear colour times coverage, and
            coverage.
        output: an OUTPUT.
        rgb_bytes: pointer to 3 channel_values(width) + 4 bytes of working memory.
    """
    channel = channel_values_in_kernel(width)
    zero, one, min_share, eight = vec.f32(0.0), vec.f32(1.0), vec.f32(1e-6), vec.i32(8)
    background = output.background
    for x in range(0, width, vec.LANES):
        r, g, b = load3(accumulated, x, channel)
        background_share = one - vec.load(accumulated, 3 * channel + x)
        background_share = vec.select(background_share > min_share, background_share, zero)
        red = _srgb_byte(r + background_share * vec.f32(background[0]), output.srgb_cells)
        green = _srgb_byte(g + background_share * vec.f32(background[1]), output.srgb_cells)
        blue = _srgb_byte(b + background_share * vec.f32(background[2]), output.srgb_cells)
        vec.store_rgb(rgb_bytes, 3 * x, red | (green << eight) | (blue << (eight + eight)))
    row = u8_at(address(output.color) + 3 * y * width)
    for k in range(3 * width):
        row[k] = rgb_bytes[k]


@kernel("void(int64, int64, int64, int64, int64)")
def finish_rows(accumulated_address, output_address, width, row_begin, row_end):
    """Finish the rows ``row_begin .. row_end - 1``.

    Args:
        accumulated_address: address of (H, 4, channel_values(width)) float32, see ``finish_row``.
        output_address: address of an OUTPUT.
    """
    channel, output = channel_values_in_kernel(width), _output_at(output_address)
    own_bytes = np.empty(3 * channel + 4, np.uint8)
    rgb_bytes = u8_at(np.int64(own_bytes.ctypes.data))
    for y in range(row_begin, row_end):
        finish_row(f32_at(accumulated_address + 16 * y * channel), output, y, width, rgb_bytes)
    own_bytes[0] = 0  # the pointer above does not keep the array alive
