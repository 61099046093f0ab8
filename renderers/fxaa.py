"""Fast approximate anti-aliasing of rendered images (T. Lottes, "FXAA", NVIDIA white paper, 2009).

Parameters and end-of-edge rule are those of VTK, because Drake's RenderEngineVtk has its FXAA enabled. Only colours are
filtered, never depth or labels.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pending import wait_until_compiled
from renderers.compiler.pointers import address_of, f32_at, u8_at
from renderers.stop import current_stop

HARD_CONTRAST: Final = np.float32(255.0 / 16.0)
"""Minimum luma range (of 255) among a pixel and its four neighbours for smoothing."""
RELATIVE_CONTRAST: Final = np.float32(1.0 / 8.0)
"""Minimum luma range relative to the brightest of them."""
SUBPIXEL_CONTRAST: Final = np.float32(1.0 / 4.0)
"""Minimum difference of a single-pixel spot from its neighbours' mean, relative to their range."""
SUBPIXEL_BLEND: Final = np.float32(3.0 / 4.0)
"""Maximum share of its surroundings in a single-pixel spot."""
SEARCH: Final = 12
"""Maximum distance of the search for the ends of an edge, pixels in either direction."""


def fxaa(color: NDArray[np.uint8]) -> None:
    """Smooth the edges of an image in place.

    Args:
        color: (H, W, 3) uint8, C-contiguous, display-encoded.

    Raises:
        Exception: the current ``StopFlag`` was set; the image is partly smoothed.
    """
    wait_until_compiled("antialiasing")
    source = np.empty_like(color)
    luma = np.empty(color.shape[:2], np.float32)
    stop = current_stop()
    addresses = address_of(source, np.uint8), address_of(luma, np.float32), address_of(color, np.uint8)
    _smooth(source, luma, *addresses, stop.address)
    stop.check()


@kernel("void(uint8[:,:,::1], float32[:,::1], int64, int64, int64, int64)")
def _smooth(source, luma, source_at, luma_at, out_at, stop_at):
    """Smooth the image at ``out_at``; ``source`` and ``luma`` are working memory. Checks the stop flag once a row."""
    height, width = luma.shape
    values, lumas = source.reshape(height * width * 3), luma.reshape(height * width)
    pixels, levels, out = u8_at(source_at), f32_at(luma_at), u8_at(out_at)
    for i in range(3 * height * width):
        values[i] = out[i]
    for i in range(height * width):
        lumas[i] = (
            np.float32(0.299) * values[3 * i]
            + np.float32(0.587) * values[3 * i + 1]
            + np.float32(0.114) * values[3 * i + 2]
        )
    contrasts = np.ones(width, np.uint8)  # first and last column: always
    for y in range(height):
        if is_set(stop_at):
            break
        north, south = min(y + 1, height - 1), max(y - 1, 0)
        _find_edges(luma[y], luma[north], luma[south], contrasts)
        for x in range(width):
            if contrasts[x]:
                west, east = max(x - 1, 0), min(x + 1, width - 1)
                c, n, s, w, e = luma[y, x], luma[north, x], luma[south, x], luma[y, west], luma[y, east]
                brightest = max(max(max(n, s), max(w, e)), c)
                contrast = brightest - min(min(min(n, s), min(w, e)), c)
                if contrast >= max(HARD_CONTRAST, RELATIVE_CONTRAST * brightest):
                    _smooth_pixel(pixels, levels, out, x, y, width, height, contrast)


@device_function
def _find_edges(row, north, south, contrasts):
    """Mark the inner pixels of a row that have contrast.

    Most of the time is spent here, because images are mostly flat. Slices with a common index let LLVM vectorise it.
    """
    cs, ns, ss, ws, es, marks = row[1:-1], north[1:-1], south[1:-1], row[:-2], row[2:], contrasts[1:-1]
    for x in range(len(row) - 2):
        c, n, s, w, e = cs[x], ns[x], ss[x], ws[x], es[x]
        brightest = max(max(max(n, s), max(w, e)), c)
        contrast = brightest - min(min(min(n, s), min(w, e)), c)
        marks[x] = np.uint8(contrast >= max(HARD_CONTRAST, RELATIVE_CONTRAST * brightest))


@device_function
def _smooth_pixel(pixels, luma, out, x, y, width, height, contrast):
    """Smooth one pixel. Takes pointers, because arrays would cost reference counts and range checks for every pixel."""
    # OpenGL's rows go upwards, which decides between neighbours of equal contrast: "north" is the row below.
    here = y * width
    north, south = min(y + 1, height - 1) * width, max(y - 1, 0) * width
    west, east = max(x - 1, 0), min(x + 1, width - 1)
    c, n, s, w, e = luma[here + x], luma[north + x], luma[south + x], luma[here + west], luma[here + east]
    nw, ne, sw, se = luma[north + west], luma[north + east], luma[south + west], luma[south + east]
    # The direction of the edge, from second differences across rows and columns with the middle one counting twice.
    two = np.float32(2.0)
    across_columns = abs(nw + ne - two * n) + two * abs(w + e - two * c) + abs(sw + se - two * s)
    across_rows = abs(nw + sw - two * w) + two * abs(n + s - two * c) + abs(ne + se - two * e)
    horizontal = across_rows >= across_columns
    # The pixel beyond the edge: the neighbour of highest contrast perpendicular to it.
    first, second = (n, s) if horizontal else (w, e)
    if abs(c - first) >= abs(c - second):
        over = first
        beyond = north + x if horizontal else here + west
    else:
        over = second
        beyond = south + x if horizontal else here + east
    # Along the edge: the number of pixels on either side of this one, and their stride.
    before, behind, step = (x, width - 1 - x, 1) if horizontal else (y, height - 1 - y, width)
    back, luma_back = _edge_end(luma, here + x, beyond, -step, before, c, over)
    ahead, luma_ahead = _edge_end(luma, here + x, beyond, step, behind, c, over)
    # North is +y here but -y in OpenGL: "back" is the nearer end only if strictly nearer in OpenGL's direction.
    if horizontal:
        back_is_nearer = back < ahead
    else:
        back_is_nearer = back <= ahead
    end = luma_back if back_is_nearer else luma_ahead
    shift = np.float32(0.0)
    if abs(end - over) < abs(end - c):
        shift = np.float32(0.5) - np.float32(min(back, ahead)) / np.float32(back + ahead)
    # A single-pixel spot is blended with its surroundings.
    mean = np.float32(0.25) * (n + s + w + e)
    spot = abs(mean - c) / contrast - SUBPIXEL_CONTRAST
    blend = min(SUBPIXEL_BLEND, max(np.float32(0.0), spot / (np.float32(1.0) - SUBPIXEL_CONTRAST)))
    for k in range(3):
        center = np.float32(pixels[3 * (here + x) + k])
        edge = center + shift * (np.float32(pixels[3 * beyond + k]) - center)
        value = edge
        if blend > np.float32(0.0):
            # Sums of bytes are exact in any order.
            around = np.int32(0)
            for row in (north, here, south):
                around += (
                    np.int32(pixels[3 * (row + west) + k])
                    + np.int32(pixels[3 * (row + x) + k])
                    + np.int32(pixels[3 * (row + east) + k])
                )
            value = edge + blend * (np.float32(around) / np.float32(9.0) - edge)
        out[3 * (here + x) + k] = np.uint8(value + np.float32(0.5))


@device_function
def _edge_end(luma, own, other, step, left, c, over):
    """Return the distance of the edge's end in pixels and the luma there on the pixel's own side.

    VTK's rule: the edge ends where a pixel on one side is more like the other side, which also finds the ends of lines
    one pixel wide. Beyond the image border, ``left`` pixels away, the last pixel continues.
    """
    distance, here = 1, c
    for _ in range(SEARCH):
        at = min(distance, left) * step
        here, there = luma[own + at], luma[other + at]
        if abs(there - over) > abs(there - c) or abs(here - c) > abs(here - over):
            break
        distance += 1
    return distance, here
