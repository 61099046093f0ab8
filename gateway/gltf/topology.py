"""Primitive modes as lists of points, lines or triangles."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.gltf.accessors import own

MODES: Final = ("POINTS", "LINES", "LINE_LOOP", "LINE_STRIP", "TRIANGLES", "TRIANGLE_STRIP", "TRIANGLE_FAN")


def element_count(mode: int, vertices: int) -> int:
    """How many elements ``vertices`` indices make."""
    if mode == 0:
        return vertices
    if mode == 2:
        return vertices if vertices >= 2 else 0
    if mode in (1, 4):
        return vertices // (2 if mode == 1 else 3)
    return max(0, vertices - (1 if mode == 3 else 2))


def elements_of(mode: int, indices: NDArray[Any]) -> NDArray[np.uint32]:
    """Elements of a primitive; counter-clockwise winding is kept. Incomplete ones at the end are dropped.

    Args:
        mode: 0 .. 6, as in ``MODES``.
        indices: (N,) of any unsigned type.

    Returns:
        (M, 1 | 2 | 3) uint32, C-contiguous; a view of ``indices`` where that is possible.
    """
    count = element_count(mode, len(indices))
    if mode == 0:
        return own(indices.reshape(-1, 1), np.uint32)
    if mode == 1:
        return own(indices[: 2 * count].reshape(-1, 2), np.uint32)
    if mode == 4:
        return own(indices[: 3 * count].reshape(-1, 3), np.uint32)
    size = 2 if mode in (2, 3) else 3
    result = np.empty((count, size), np.uint32)
    if count == 0:
        return result
    if mode == 2:
        result[:, 0] = indices
        result[:-1, 1] = indices[1:]
        result[-1, 1] = indices[0]
    elif mode == 3:
        result[:, 0], result[:, 1] = indices[:-1], indices[1:]
    elif mode == 5:
        # Triangle i is (i, i + 1 + i % 2, i + 2 - i % 2): every second one turns the other way round.
        result[:, 0] = indices[:-2]
        result[0::2, 1], result[0::2, 2] = indices[1:-1:2], indices[2::2]
        result[1::2, 1], result[1::2, 2] = indices[3::2], indices[2:-1:2]
    else:
        # The specification turns fans so that the centre comes last: (i + 1, i + 2, 0).
        result[:, 0], result[:, 1], result[:, 2] = indices[1:-1], indices[2:], indices[0]
    return result
