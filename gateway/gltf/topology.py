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
_INDICES_PER_ELEMENT: Final = {POINTS: 1, LINES: 2, TRIANGLES: 3}
"""Vertices of a primitive by mode, for modes whose primitives share no indices."""


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
    if mode == LINE_STRIP:
        return max(0, index_count - 1)
    return max(0, index_count - 2)  # TRIANGLE_STRIP, TRIANGLE_FAN


def separate_elements(mode: int, indices: NDArray[Any]) -> NDArray[np.uint32]:
    """Return the points, lines or triangles of a primitive. Winding is kept; an incomplete last element is dropped.

    Args:
        mode: ``primitive.mode``, 0 .. 6.
        indices: (N,) of any unsigned integer type.

    Returns:
        (M, 1 | 2 | 3) uint32, C-contiguous: a copy.
    """
    count = element_count(mode, len(indices))
    if mode in _INDICES_PER_ELEMENT:
        indices_per_element = _INDICES_PER_ELEMENT[mode]
        return indices[: count * indices_per_element].astype(np.uint32).reshape(-1, indices_per_element)
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
        elements[:, 0] = indices[:-2]
        even, odd = elements[0::2], elements[1::2]
        even[:, 1], even[:, 2] = indices[1:-1:2], indices[2::2]  # triangle i is (i, i + 1, i + 2)
        odd[:, 1], odd[:, 2] = indices[3::2], indices[2:-1:2]  # (i, i + 2, i + 1), for the same winding
    else:
        # glTF 2.0, section 3.7.2.1: triangle i of a fan is (i + 1, i + 2, 0).
        elements[:, 0], elements[:, 1], elements[:, 2] = indices[1:-1], indices[2:], indices[0]
    return elements
