"""Kernels of ``mesh``. Disparities are in units of 1/16 pixel, 0: no point."""

from __future__ import annotations

import numpy as np
from numba import njit

from renderers.compiler.cache_locator import cached_njit


@cached_njit(nogil=True)
def bin_points(disparity, n, nearest, d, u, v):
    """Write disparity and pixel position of each n x n bin's point: its nearest pixel, or the mean of its valid pixels.

    The mean over pixels of a plane lies on the plane, because disparity is affine in the pixel position there.
    """
    height, width = disparity.shape
    rows, columns = d.shape
    for r in range(rows):
        for c in range(columns):
            total, count, x, y, best = 0, 0, 0, 0, 0
            for k in range(r * n, min((r + 1) * n, height)):
                for i in range(c * n, min((c + 1) * n, width)):
                    value = int(disparity[k, i])
                    if value == 0:
                        continue
                    if nearest:
                        if value > best:
                            best, x, y, count, total = value, i, k, 1, value
                    else:
                        total += value
                        x += i
                        y += k
                        count += 1
            if count == 0:
                d[r, c] = 0.0
                u[r, c] = (c + 0.5) * n
                v[r, c] = (r + 0.5) * n
            else:
                d[r, c] = total / count
                u[r, c] = x / count + 0.5
                v[r, c] = y / count + 0.5


@cached_njit(nogil=True)
def fill_all(d, u, v):
    """Give every empty bin the farther of its two neighbours in the row; copy empty rows from the nearest row.

    The farther one, because the background continues behind an edge.
    """
    rows, columns = d.shape
    first, last = -1, -1
    for r in range(rows):
        left = np.float32(0.0)
        c = 0
        while c < columns:
            if d[r, c] > 0.0:
                left = d[r, c]
                c += 1
                continue
            start = c
            while c < columns and d[r, c] == 0.0:
                c += 1
            right = d[r, c] if c < columns else np.float32(0.0)
            value = min(left, right) if left > 0.0 and right > 0.0 else max(left, right)
            for j in range(start, c):
                d[r, j] = value
        if d[r, 0] > 0.0:
            if first < 0:
                first = r
            last = r
        elif last >= 0:
            _copy_row(d, last, r)
    if first > 0:
        for r in range(first):
            _copy_row(d, first, r)


@njit(inline="always")
def _copy_row(d, source, row):
    """Copy by a loop: an assignment of slices would compile code for its errors, too."""
    for c in range(d.shape[1]):
        d[row, c] = d[source, c]


@cached_njit(nogil=True)
def make_points(d, u, v, f, cx, cy, t, footprint, index, out):
    """Write the 3D point and footprint of every valid bin, and the bin's vertex index (-1: no point).

    The manual's formula: P = ((u - cx) t / d, (v - cy) t / d, f t / d), with t in metres per unit of d.
    """
    n = 0
    for r in range(d.shape[0]):
        for c in range(d.shape[1]):
            index[r, c] = -1
            if d[r, c] > 0.0:
                index[r, c] = n
                s = t / d[r, c]
                out[n, 0] = (u[r, c] - cx) * s
                out[n, 1] = (v[r, c] - cy) * s
                out[n, 2] = f * s
                out[n, 3] = footprint / d[r, c]
                n += 1


@njit(inline="always")
def _valid_corners(d, r, c, max_step):
    """Return the number of valid corners of the cell below and right of (r, c), 0 if it is not connected."""
    low, high, valid = np.float32(np.inf), np.float32(0.0), 0
    for value in (d[r, c], d[r, c + 1], d[r + 1, c + 1], d[r + 1, c]):
        if value > 0.0:
            valid += 1
            low = min(low, value)
            high = max(high, value)
    return valid if valid >= 3 and high - low <= max_step else 0


@cached_njit(nogil=True)
def count_faces(d, max_step):
    count = 0
    for r in range(d.shape[0] - 1):
        for c in range(d.shape[1] - 1):
            count += max(_valid_corners(d, r, c, max_step) - 2, 0)
    return count


@cached_njit(nogil=True)
def make_faces(d, index, max_step, out):
    """Write the triangles, counter-clockwise seen from the camera: the vendor's order (i-1,k-1), (i-1,k), (i,k),
    (i,k-1)."""
    n = 0
    for r in range(d.shape[0] - 1):
        for c in range(d.shape[1] - 1):
            if _valid_corners(d, r, c, max_step) == 0:
                continue
            first, second, third = -1, -1, -1
            for corner in (index[r, c], index[r + 1, c], index[r + 1, c + 1], index[r, c + 1]):
                if corner < 0:
                    continue
                if first < 0:
                    first = corner
                elif second < 0:
                    second = corner
                elif third < 0:
                    third = corner
                    out[n, 0], out[n, 1], out[n, 2] = first, second, third
                    n += 1
                else:
                    out[n, 0], out[n, 1], out[n, 2] = third, corner, first
                    n += 1
