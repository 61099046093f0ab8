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


def separate_elements(mode: int, indices: NDArray[Any], restart: int | None = None) -> NDArray[np.uint32]:
    """Return the points, lines or triangles of a primitive. Winding is kept; an incomplete last element is dropped.

    Args:
        mode: ``primitive.mode``, 0 .. 6.
        indices: (N,) of any unsigned integer type.
        restart: Index that starts another strip, loop or fan (primitive restart); None: there is none. In lists of
            points, lines or triangles it is an index as any other, as in WebGPU.

    Returns:
        (M, 1 | 2 | 3) uint32, C-contiguous: a copy.
    """
    if mode in _INDICES_PER_ELEMENT:
        indices_per_element = _INDICES_PER_ELEMENT[mode]
        count = element_count(mode, len(indices))
        return indices[: count * indices_per_element].astype(np.uint32).reshape(-1, indices_per_element)
    at = np.arange(len(indices), dtype=np.int32)
    is_restart = np.zeros(len(indices), np.bool_) if restart is None else indices == restart
    first = np.maximum.accumulate(np.where(is_restart, at + 1, 0))  # of the strip, loop or fan
    has_next = ~is_restart
    has_next[:-1] &= ~is_restart[1:]
    has_next[-1:] = False
    corners: tuple[NDArray[np.int32], ...]
    if mode == LINE_STRIP:
        at = at[has_next]
        corners = at, at + 1
    elif mode == LINE_LOOP:
        following = np.where(has_next, at + 1, first)
        is_line = ~is_restart & (following != at)  # a loop of one vertex has none
        corners = at[is_line], following[is_line]
    elif mode == TRIANGLE_STRIP:
        at = at[:-1][has_next[:-1] & has_next[1:]]
        odd = (at - first[at]) & 1
        corners = at, at + 1 + odd, at + 2 - odd  # triangle i is (i, i + 1, i + 2), or (i, i + 2, i + 1) for odd i
    else:
        at = at[has_next & (at > first)]
        corners = at, at + 1, first[at]  # glTF 2.0, section 3.7.2.1: triangle i of a fan is (i + 1, i + 2, 0)
    return np.stack([indices[corner] for corner in corners], axis=1).astype(np.uint32)
