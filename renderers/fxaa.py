"""Fast approximate anti-aliasing of rendered images (T. Lottes, "FXAA", NVIDIA white paper, 2009).

The parameters and the rule for the ends of edges are VTK's, because Drake's RenderEngineVtk enables VTK's FXAA. Only
colours are filtered, never depth or labels. Names in kernels: c, n, s, w, e are the lumas of a pixel and of its
neighbours north, south, west and east. North is the row below: rows of OpenGL go upwards, which decides between
neighbours of equal contrast.
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
"""Minimum range of the lumas (0 to 255) of a pixel and its four neighbours for smoothing."""
RELATIVE_CONTRAST: Final = np.float32(1.0 / 8.0)
"""Minimum range relative to the largest of the lumas."""
SUBPIXEL_CONTRAST: Final = np.float32(1.0 / 4.0)
"""Minimum difference between a single-pixel spot and the mean of its neighbours, relative to the range."""
SUBPIXEL_BLEND: Final = np.float32(3.0 / 4.0)
"""Maximum share of the neighbours' mean in a single-pixel spot."""
MAX_SEARCH: Final = 12
"""Maximum distance in which the ends of an edge are searched, pixels in either direction."""


def fxaa(color: NDArray[np.uint8]) -> None:
    """Smooth the edges of an image in place.

    Args:
        color: (H, W, 3) uint8, C-contiguous, display-encoded.

    Raises:
        Exception: the error of the current ``StopFlag``, if it was set. The image is partly smoothed then.
    """
    wait_until_compiled("antialiasing")
    copy = np.empty_like(color)
    luma = np.empty(color.shape[:2], np.float32)
    stop = current_stop()
    addresses = address_of(copy, np.uint8), address_of(luma, np.float32), address_of(color, np.uint8)
    _smooth(copy, luma, *addresses, stop.address)
    stop.check()


@kernel("void(uint8[:,:,::1], float32[:,::1], int64, int64, int64, int64)")
def _smooth(copy, luma, copy_address, luma_address, color_address, stop_address):
    """Smooth an image, and check the stop flag once per row.

    Args:
        copy: (H, W, 3) uint8, working memory, also at ``copy_address``.
        luma: (H, W) float32, working memory, also at ``luma_address``.
        color_address: address of (H, W, 3) uint8.
    """
    height, width = luma.shape
    copied_values, luma_values = copy.reshape(height * width * 3), luma.reshape(height * width)
    source, luma_pointer, color = u8_at(copy_address), f32_at(luma_address), u8_at(color_address)
    for i in range(3 * height * width):
        copied_values[i] = color[i]
    for i in range(height * width):
        luma_values[i] = (
            np.float32(0.299) * copied_values[3 * i]
            + np.float32(0.587) * copied_values[3 * i + 1]
            + np.float32(0.114) * copied_values[3 * i + 2]
        )
    may_be_edge = np.ones(width, np.uint8)  # the first and last columns are not examined by _find_edges
    for y in range(height):
        if is_set(stop_address):
            break
        north, south = min(y + 1, height - 1), max(y - 1, 0)
        _find_edges(luma[y], luma[north], luma[south], may_be_edge)
        for x in range(width):
            if may_be_edge[x]:
                west, east = max(x - 1, 0), min(x + 1, width - 1)
                c, n, s, w, e = luma[y, x], luma[north, x], luma[south, x], luma[y, west], luma[y, east]
                brightest = max(max(max(n, s), max(w, e)), c)
                contrast = brightest - min(min(min(n, s), min(w, e)), c)
                if contrast >= max(HARD_CONTRAST, RELATIVE_CONTRAST * brightest):
                    _smooth_pixel(source, luma_pointer, color, x, y, width, height, contrast)


@device_function
def _find_edges(row, north, south, may_be_edge):
    """Set ``may_be_edge`` (uint8) for the inner pixels of a row of lumas.

    Most of the time is spent here, because images are mostly flat. Slices with a common index let LLVM vectorise it.
    """
    cs, ns, ss, ws, es, marks = row[1:-1], north[1:-1], south[1:-1], row[:-2], row[2:], may_be_edge[1:-1]
    for x in range(len(row) - 2):
        c, n, s, w, e = cs[x], ns[x], ss[x], ws[x], es[x]
        brightest = max(max(max(n, s), max(w, e)), c)
        contrast = brightest - min(min(min(n, s), min(w, e)), c)
        marks[x] = np.uint8(contrast >= max(HARD_CONTRAST, RELATIVE_CONTRAST * brightest))


@device_function
def _smooth_pixel(source, luma, color, x, y, width, height, contrast):
    """Smooth one pixel. Takes pointers, because arrays would cost reference counts and range checks for every pixel."""
    row = y * width
    north, south = min(y + 1, height - 1) * width, max(y - 1, 0) * width
    west, east = max(x - 1, 0), min(x + 1, width - 1)
    c, n, s, w, e = luma[row + x], luma[north + x], luma[south + x], luma[row + west], luma[row + east]
    nw, ne, sw, se = luma[north + west], luma[north + east], luma[south + west], luma[south + east]
    # The direction of the edge, from second differences across rows and columns. The middle one counts twice.
    two = np.float32(2.0)
    across_columns = abs(nw + ne - two * n) + two * abs(w + e - two * c) + abs(sw + se - two * s)
    across_rows = abs(nw + sw - two * w) + two * abs(n + s - two * c) + abs(ne + se - two * e)
    is_horizontal = across_rows >= across_columns
    # The pixel across the edge: of the two neighbours perpendicular to it, the one of higher contrast.
    north_or_west, south_or_east = (n, s) if is_horizontal else (w, e)
    if abs(c - north_or_west) >= abs(c - south_or_east):
        luma_across = north_or_west
        pixel_across = north + x if is_horizontal else row + west
    else:
        luma_across = south_or_east
        pixel_across = south + x if is_horizontal else row + east
    # Along the edge: the number of pixels of the image on either side of this one, and their stride.
    room_before, room_after, stride = (x, width - 1 - x, 1) if is_horizontal else (y, height - 1 - y, width)
    before, luma_before = _edge_end(luma, row + x, pixel_across, -stride, room_before, c, luma_across)
    after, luma_after = _edge_end(luma, row + x, pixel_across, stride, room_after, c, luma_across)
    # If both ends are equally far, OpenGL's order decides, in which rows are reversed.
    if is_horizontal:
        nearer_is_before = before < after
    else:
        nearer_is_before = before <= after
    luma_end = luma_before if nearer_is_before else luma_after
    shift = np.float32(0.0)
    if abs(luma_end - luma_across) < abs(luma_end - c):
        shift = np.float32(0.5) - np.float32(min(before, after)) / np.float32(before + after)
    # A single-pixel spot is blended with the mean of the 3 x 3 pixels around it.
    neighbour_mean = np.float32(0.25) * (n + s + w + e)
    excess = abs(neighbour_mean - c) / contrast - SUBPIXEL_CONTRAST
    blend = min(SUBPIXEL_BLEND, max(np.float32(0.0), excess / (np.float32(1.0) - SUBPIXEL_CONTRAST)))
    for k in range(3):
        own = np.float32(source[3 * (row + x) + k])
        value = own + shift * (np.float32(source[3 * pixel_across + k]) - own)
        if blend > np.float32(0.0):
            # Sums of bytes are exact in any order.
            total = np.int32(0)
            for line in (north, row, south):
                total += (
                    np.int32(source[3 * (line + west) + k])
                    + np.int32(source[3 * (line + x) + k])
                    + np.int32(source[3 * (line + east) + k])
                )
            value = value + blend * (np.float32(total) / np.float32(9.0) - value)
        color[3 * (row + x) + k] = np.uint8(value + np.float32(0.5))


@device_function
def _edge_end(luma, pixel, pixel_across, stride, room, c, luma_across):
    """Return the distance of the edge's end in pixels, and the luma there on the pixel's own side.

    VTK's rule: the edge ends where a pixel on one side is more like the other side, which also finds the ends of lines
    one pixel wide.

    Args:
        pixel, pixel_across: indices of a pixel and of the one across the edge, with lumas ``c`` and ``luma_across``.
        stride: from a pixel to the next one along the edge.
        room: number of pixels up to the border of the image, beyond which the last one is repeated.
    """
    distance, own = 1, c
    for _ in range(MAX_SEARCH):
        offset = min(distance, room) * stride
        own, across = luma[pixel + offset], luma[pixel_across + offset]
        if abs(across - luma_across) > abs(across - c) or abs(own - c) > abs(own - luma_across):
            break
        distance += 1
    return distance, own
