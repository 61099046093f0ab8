"""Fast approximate anti-aliasing of rendered images (T. Lottes, "FXAA", NVIDIA white paper, 2009).

The parameters and the rule for the ends of edges are VTK's, because Drake's RenderEngineVtk enables VTK's FXAA. Only
colours are filtered, never depth or labels. Names in kernels: c, n, s, w, e are the lumas of a pixel and of its
neighbours north, south, west and east. North is the row below, since rows of OpenGL go upwards. The difference matters
where both neighbours have the same contrast.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.kernel_types import F32, I64, U8, Address, Pointer, f32, i32, u8
from renderers.compiler.pointers import address_of, f32_at, u8_at
from renderers.stop import current_stop

HARD_CONTRAST: Final = np.float32(255.0 / 16.0)
"""Minimum range of the lumas (0 to 255) of a pixel and its four neighbours. Pixels below it are not smoothed."""
RELATIVE_CONTRAST: Final = np.float32(1.0 / 8.0)
"""Minimum range of these lumas relative to the largest one."""
SUBPIXEL_CONTRAST: Final = f32(1.0 / 4.0)
"""Minimum difference between a single-pixel spot and the mean of its four neighbours, relative to the lumas' range."""
SUBPIXEL_BLEND: Final = f32(3.0 / 4.0)
"""Maximum share of the neighbours' mean that is blended into a single-pixel spot."""
MAX_SEARCH: Final = 12
"""Maximum distance at which the end of an edge is searched, pixels, in each direction."""


def fxaa(color: NDArray[np.uint8]) -> None:
    """Smooth the edges of an image, (H, W, 3), C-contiguous, display-encoded, in place.

    Raises:
        Exception: the error of the current ``StopFlag``, if it was set. The image is partly smoothed then.
    """
    height, width = color.shape[:2]
    copy, luma = np.empty(color.shape, np.uint8), np.empty((height, width), np.float32)
    may_be_edge = np.ones(width, np.uint8)  # _find_edges leaves the first and last columns at 1
    addresses = address_of(color, np.uint8), address_of(copy, np.uint8), address_of(luma, np.float32)
    stop = current_stop()
    _smooth(*addresses, address_of(may_be_edge, np.uint8), width, height, stop.address)
    stop.check()


@kernel
def _smooth(
    color_at: Address,
    copy_at: Address,
    luma_at: Address,
    may_be_edge_at: Address,
    width: I64,
    height: I64,
    stop_at: Address,
) -> None:
    """Smooth an image, and check the stop flag once per row.

    Args:
        copy_at, luma_at: working memory of (height, width, 3) uint8 and (height, width) float32.
        may_be_edge_at: working memory of (width,) uint8. The first and last values must be 1.
    """
    color, source, luma, may_be_edge = u8_at(color_at), u8_at(copy_at), f32_at(luma_at), u8_at(may_be_edge_at)
    for i in range(3 * height * width):
        source[i] = color[i]
    for i in range(height * width):
        luma[i] = f32(0.299) * source[3 * i] + f32(0.587) * source[3 * i + 1] + f32(0.114) * source[3 * i + 2]
    for y in range(height):
        if is_set(stop_at):
            break
        row, north, south = y * width, min(y + 1, height - 1) * width, max(y - 1, 0) * width
        _find_edges(luma, row, north, south, width, may_be_edge)
        for x in range(width):
            if may_be_edge[x]:
                west, east = max(x - 1, 0), min(x + 1, width - 1)
                c, n, s, w, e = luma[row + x], luma[north + x], luma[south + x], luma[row + west], luma[row + east]
                brightest = max(max(max(n, s), max(w, e)), c)
                contrast = brightest - min(min(min(n, s), min(w, e)), c)
                if contrast >= max(HARD_CONTRAST, RELATIVE_CONTRAST * brightest):
                    _smooth_pixel(source, luma, color, x, y, width, height, contrast)


@device_function
def _find_edges(luma: Pointer[F32], row: I64, north: I64, south: I64, width: I64, may_be_edge: Pointer[U8]) -> None:
    """Set ``may_be_edge`` for the pixels of a row, except the first and the last.

    Most of the time is spent here, since few pixels are at edges. LLVM vectorises the loop. ``row``, ``north`` and
    ``south`` are the indices in ``luma`` of the first pixel of the row and of its neighbours.
    """
    for x in range(1, width - 1):
        c, n, s, w, e = luma[row + x], luma[north + x], luma[south + x], luma[row + x - 1], luma[row + x + 1]
        brightest = max(max(max(n, s), max(w, e)), c)
        contrast = brightest - min(min(min(n, s), min(w, e)), c)
        may_be_edge[x] = u8(contrast >= max(HARD_CONTRAST, RELATIVE_CONTRAST * brightest))


@device_function
def _smooth_pixel(
    source: Pointer[U8], luma: Pointer[F32], color: Pointer[U8], x: I64, y: I64, width: I64, height: I64, contrast: F32
) -> None:
    """Smooth a pixel of ``source`` into ``color``; ``contrast``: range of its luma and those of its four neighbours."""
    row = y * width
    north, south = min(y + 1, height - 1) * width, max(y - 1, 0) * width
    west, east = max(x - 1, 0), min(x + 1, width - 1)
    c, n, s, w, e = luma[row + x], luma[north + x], luma[south + x], luma[row + west], luma[row + east]
    nw, ne, sw, se = luma[north + west], luma[north + east], luma[south + west], luma[south + east]
    # The direction of the edge, from second differences across columns and across rows. The middle ones count twice.
    two = f32(2.0)
    across_columns = abs(nw + ne - two * n) + two * abs(w + e - two * c) + abs(sw + se - two * s)
    across_rows = abs(nw + sw - two * w) + two * abs(n + s - two * c) + abs(ne + se - two * e)
    is_horizontal = across_rows >= across_columns
    # The pixel across the edge: of the two neighbours perpendicular to the edge, the one of higher contrast.
    north_or_west, south_or_east = (n, s) if is_horizontal else (w, e)
    if abs(c - north_or_west) >= abs(c - south_or_east):
        luma_across = north_or_west
        pixel_across = north + x if is_horizontal else row + west
    else:
        luma_across = south_or_east
        pixel_across = south + x if is_horizontal else row + east
    # Along the edge: the number of pixels of the image before and after this one, and their stride.
    pixels_before, pixels_after, stride = (x, width - 1 - x, 1) if is_horizontal else (y, height - 1 - y, width)
    before, luma_before = _edge_end(luma, row + x, pixel_across, -stride, pixels_before, c, luma_across)
    after, luma_after = _edge_end(luma, row + x, pixel_across, stride, pixels_after, c, luma_across)
    # If both ends are equally far, the shift is 0 for either.
    luma_end = luma_before if before < after else luma_after
    shift = f32(0.0)
    if abs(luma_end - luma_across) < abs(luma_end - c):
        shift = f32(0.5) - f32(min(before, after)) / f32(before + after)
    # A single-pixel spot is blended with the mean of the 3 x 3 pixels around it.
    neighbour_mean = f32(0.25) * (n + s + w + e)
    excess = abs(neighbour_mean - c) / contrast - SUBPIXEL_CONTRAST
    blend = min(SUBPIXEL_BLEND, max(f32(0.0), excess / (f32(1.0) - SUBPIXEL_CONTRAST)))
    for k in range(3):
        own = f32(source[3 * (row + x) + k])
        value = own + shift * (f32(source[3 * pixel_across + k]) - own)
        if blend > f32(0.0):
            value = value + blend * (_mean_of_nine(source, (north, row, south), (west, x, east), k) - value)
        color[3 * (row + x) + k] = u8(value + f32(0.5))


@inlined
def _mean_of_nine(source: Pointer[U8], rows: tuple[I64, I64, I64], columns: tuple[I64, I64, I64], k: I64) -> F32:
    """Return the mean of channel ``k`` over 3 x 3 pixels; ``rows``: indices of the rows' first pixels."""
    total = i32(0)
    for row in rows:
        for column in columns:
            total += i32(source[3 * (row + column) + k])
    return f32(total) / f32(9.0)


@device_function
def _edge_end(
    luma: Pointer[F32], pixel: I64, pixel_across: I64, stride: I64, max_distance: I64, c: F32, luma_across: F32
) -> tuple[I64, F32]:
    """Return the distance of the edge's end in pixels, and the luma there on the pixel's own side.

    As in VTK, the edge ends where the luma on one side is closer to the luma that the other side has at the start. This
    also finds the ends of lines one pixel wide.

    Args:
        pixel, pixel_across: indices of a pixel and of the one across the edge, which have the lumas c and
            ``luma_across``.
        stride: difference of the indices of neighbouring pixels along the edge.
        max_distance: number of pixels up to the border of the image. Beyond it, the last pixel is repeated.
    """
    distance, own = 1, c
    for _ in range(MAX_SEARCH):
        offset = min(distance, max_distance) * stride
        own, across = luma[pixel + offset], luma[pixel_across + offset]
        if abs(across - luma_across) > abs(across - c) or abs(own - c) > abs(own - luma_across):
            break
        distance += 1
    return distance, own
