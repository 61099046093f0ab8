"""Converts index lists of any primitive mode (strips, fans, loops) to separate points, lines or triangles."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

POINTS: Final = 0
LINES: Final = 1
LINE_LOOP: Final = 2
LINE_STRIP: Final = 3
TRIANGLES: Final = 4
TRIANGLE_STRIP: Final = 5
TRIANGLE_FAN: Final = 6
MODE_COUNT: Final = 7
"""Number of values of ``primitive.mode``, which are the constants above."""
_SEPARATE_SIZES: Final = {POINTS: 1, LINES: 2, TRIANGLES: 3}
"""Number of indices of an element, by mode, for modes whose elements share no indices."""


def element_count(mode: int, index_count: int) -> int:
    """Return the number of points, lines or triangles that ``index_count`` indices make."""
    if mode == POINTS:
        return index_count
    if mode == LINES:
        return index_count // 2
    if mode == LINE_LOOP:
        return index_count if index_count >= 2 else 0
    if mode == TRIANGLES:
        return index_count // 3
    return max(0, index_count - (1 if mode == LINE_STRIP else 2))


def elements_of(mode: int, indices: NDArray[Any]) -> NDArray[np.uint32]:
    """Return the points, lines or triangles of a primitive. Winding is kept; an incomplete last element is dropped.

    Args:
        mode: ``primitive.mode``, 0 .. 6.
        indices: (N,) of any unsigned integer type.

    Returns:
        (M, 1 | 2 | 3) uint32, C-contiguous: a copy.
    """
    count = element_count(mode, len(indices))
    size = _SEPARATE_SIZES.get(mode)
    if size is not None:
        return indices[: count * size].astype(np.uint32).reshape(-1, size)
    elements = np.empty((count, 2 if mode in (LINE_LOOP, LINE_STRIP) else 3), np.uint32)
    if count == 0:
        return elements
    if mode == LINE_LOOP:
        elements[:, 0] = indices
        elements[:-1, 1] = indices[1:]
        elements[-1, 1] = indices[0]
    elif mode == LINE_STRIP:
        elements[:, 0], elements[:, 1] = indices[:-1], indices[1:]
    elif mode == TRIANGLE_STRIP:
        # Triangle i is (i, i + 1 + i % 2, i + 2 - i % 2): the last two vertices of every second triangle are swapped.
        elements[:, 0] = indices[:-2]
        elements[0::2, 1], elements[0::2, 2] = indices[1:-1:2], indices[2::2]
        elements[1::2, 1], elements[1::2, 2] = indices[3::2], indices[2:-1:2]
    else:
        # glTF 2.0, section 3.7.2.1: triangle i of a fan is (i + 1, i + 2, 0).
        elements[:, 0], elements[:, 1], elements[:, 2] = indices[1:-1], indices[2:], indices[0]
    return elements
