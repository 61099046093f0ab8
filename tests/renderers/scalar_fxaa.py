"""Scalar reference for anti-aliasing: the same arithmetic as ``renderers.fxaa``, on arrays instead of pointers."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from renderers.fxaa import HARD_CONTRAST, MAX_SEARCH, RELATIVE_CONTRAST, SUBPIXEL_BLEND, SUBPIXEL_CONTRAST


def fxaa(color: NDArray[np.uint8]) -> None:
    """In place, (H, W, 3) uint8."""
    _smooth(color.copy(), np.empty(color.shape[:2], np.float32), color)


@njit(nogil=True, error_model="numpy")
def _smooth(source: NDArray[np.uint8], luma: NDArray[np.float32], out: NDArray[np.uint8]) -> None:
    """``out`` holds a copy of ``source``; ``luma`` is scratch."""
    height, width = luma.shape
    values, lumas = source.reshape(height * width * 3), luma.reshape(height * width)
    for i in range(height * width):
        lumas[i] = (
            np.float32(0.299) * values[3 * i]
            + np.float32(0.587) * values[3 * i + 1]
            + np.float32(0.114) * values[3 * i + 2]
        )
    hot = np.ones(width, np.uint8)  # the first and the last column are always looked at closely
    for y in range(height):
        # OpenGL's rows go upwards, which decides between neighbours of equal contrast: "north" is the row below.
        north, south = min(y + 1, height - 1), max(y - 1, 0)
        _find_edges(luma[y], luma[north], luma[south], hot)
        for x in range(width):
            if hot[x]:
                west, east = max(x - 1, 0), min(x + 1, width - 1)
                c, n, s, w, e = luma[y, x], luma[north, x], luma[south, x], luma[y, west], luma[y, east]
                brightest = max(max(max(n, s), max(w, e)), c)
                contrast = brightest - min(min(min(n, s), min(w, e)), c)
                if contrast >= max(HARD_CONTRAST, RELATIVE_CONTRAST * brightest):
                    _smooth_pixel(source, luma, out, x, y, west, east, north, south, contrast)


@njit(nogil=True, error_model="numpy")
def _find_edges(row, north, south, hot):
    """Mark the inner pixels of a row that have contrast. Slices with a common index let LLVM vectorize the loop."""
    inner = len(row) - 2
    cs, ns, ss, ws, es, hots = row[1:-1], north[1:-1], south[1:-1], row[:-2], row[2:], hot[1:-1]
    for x in range(inner):
        c, n, s, w, e = cs[x], ns[x], ss[x], ws[x], es[x]
        brightest = max(max(max(n, s), max(w, e)), c)
        contrast = brightest - min(min(min(n, s), min(w, e)), c)
        hots[x] = np.uint8(contrast >= max(HARD_CONTRAST, RELATIVE_CONTRAST * brightest))


@njit(nogil=True, error_model="numpy")
def _smooth_pixel(source, luma, out, x, y, west, east, north, south, contrast):
    c, n, s, w, e = luma[y, x], luma[north, x], luma[south, x], luma[y, west], luma[y, east]
    nw, ne, sw, se = luma[north, west], luma[north, east], luma[south, west], luma[south, east]
    # Second differences across rows and columns, the middle one counting twice: which way does the edge run?
    two = np.float32(2.0)
    across_columns = abs(nw + ne - two * n) + two * abs(w + e - two * c) + abs(sw + se - two * s)
    across_rows = abs(nw + sw - two * w) + two * abs(n + s - two * c) + abs(ne + se - two * e)
    horizontal = across_rows >= across_columns
    # The pixel over the edge: the neighbour of highest contrast perpendicular to it.
    first, second = (n, s) if horizontal else (w, e)
    if abs(c - first) >= abs(c - second):
        over = first
        ox, oy = (x, north) if horizontal else (west, y)
    else:
        over = second
        ox, oy = (x, south) if horizontal else (east, y)
    dx, dy = (1, 0) if horizontal else (0, 1)
    back, luma_back = _edge_end(luma, x, y, ox, oy, -dx, -dy, c, over)
    ahead, luma_ahead = _edge_end(luma, x, y, ox, oy, dx, dy, c, over)
    # North is +y here but -y in OpenGL: "back" is the nearer end only if strictly nearer in OpenGL's direction.
    if horizontal:
        back_is_nearer = back < ahead
    else:
        back_is_nearer = back <= ahead
    end = luma_back if back_is_nearer else luma_ahead
    shift = np.float32(0.0)
    if abs(end - over) < abs(end - c):
        shift = np.float32(0.5) - np.float32(min(back, ahead)) / np.float32(back + ahead)
    # A lone spot is blended with its surroundings.
    mean = np.float32(0.25) * (n + s + w + e)
    spot = abs(mean - c) / contrast - SUBPIXEL_CONTRAST
    blend = min(SUBPIXEL_BLEND, max(np.float32(0.0), spot / (np.float32(1.0) - SUBPIXEL_CONTRAST)))
    for k in range(3):
        center = np.float32(source[y, x, k])
        edge = center + shift * (np.float32(source[oy, ox, k]) - center)
        around = np.float32(0.0)
        for row in (north, y, south):
            for column in (west, x, east):
                around += np.float32(source[row, column, k])
        value = edge + blend * (around / np.float32(9.0) - edge)
        out[y, x, k] = np.uint8(value + np.float32(0.5))


@njit(nogil=True, error_model="numpy")
def _edge_end(luma, x, y, ox, oy, dx, dy, c, over):
    """Walk along an edge until a pixel is more like the other side (VTK's rule, which also ends at one-pixel lines).

    Return the distance in pixels and the luma at the end on the pixel's own side.
    """
    height, width = luma.shape
    distance, here = 1, c
    for _ in range(MAX_SEARCH):
        here = luma[min(max(y + distance * dy, 0), height - 1), min(max(x + distance * dx, 0), width - 1)]
        there = luma[min(max(oy + distance * dy, 0), height - 1), min(max(ox + distance * dx, 0), width - 1)]
        if abs(there - over) > abs(there - c) or abs(here - c) > abs(here - over):
            break
        distance += 1
    return distance, here
