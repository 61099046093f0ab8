"""Converts index lists of any primitive mode (strips, fans, loops) to separate points, lines or triangles."""

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


def restart_index(mode: int, indices: NDArray[Any]) -> int | None:
    """Return the index that starts another strip, loop or fan (primitive restart); None if ``indices`` have none.

    glTF forbids it, the largest of a component type, but files such as Cesium's vector tiles have it. In lists of
    points, lines or triangles it is an index as any other, as in WebGPU.
    """
    if mode in _INDICES_PER_ELEMENT or indices.dtype.kind != "u":
        return None
    restart = int(np.iinfo(indices.dtype).max)
    return restart if (indices == restart).any() else None


def separate_elements(mode: int, indices: NDArray[Any], restart: int | None = None) -> NDArray[np.uint32]:
    """Return the points, lines or triangles of a primitive as a copy, (M, 1 | 2 | 3), C-contiguous.

    Winding is kept; an incomplete last element is dropped. ``restart`` is the result of ``restart_index``.
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
    return elements if restart is None else _restarted(mode, indices, restart, elements)


def _restarted(mode: int, indices: NDArray[Any], restart: int, elements: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """Return the elements of several strips, loops or fans from those of a single one with the same ``indices``."""
    at = np.arange(len(indices), dtype=np.int32)
    is_restart = indices == restart
    first = np.maximum.accumulate(np.where(is_restart, at + 1, 0))  # of the strip, loop or fan
    has_next = ~(is_restart[:-1] | is_restart[1:])  # the next index is of the same strip, loop or fan
    if mode == LINE_STRIP:
        is_kept = has_next
    elif mode == LINE_LOOP:
        is_last = ~is_restart & ~np.append(has_next, False)
        elements[is_last, 1] = indices[first[is_last]]
        is_kept = ~is_restart & ~(is_last & (at == first))  # a loop of one vertex has no line
    elif mode == TRIANGLE_STRIP:
        begins_odd = (first[:-2] & 1).astype(np.bool_)
        elements[begins_odd, 1:] = elements[begins_odd, :0:-1]
        is_kept = has_next[:-1] & has_next[1:]
    else:
        elements[:, 2] = indices[first[1:-1]]
        is_kept = has_next[1:] & (at[1:-1] > first[1:-1])
    kept: NDArray[np.uint32] = elements[is_kept]
    return kept
