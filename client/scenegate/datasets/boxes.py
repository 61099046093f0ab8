"""Boxes of objects: of the pixels of a mask, and corners and edges of those in space."""

from itertools import combinations, product
from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

CORNERS: Final = tuple(product((0, 1), repeat=3))
"""Corners of a box: 0 or 1 along x, y and z for the smallest or the largest coordinate."""
EDGES: Final = tuple(
    (i, k)
    for i, k in combinations(range(8), 2)
    if sum(a != b for a, b in zip(CORNERS[i], CORNERS[k], strict=True)) == 1
)
"""Edges of a box: indices of two ``CORNERS``."""


def box_corners(box: ArrayLike) -> NDArray[np.float64]:
    """Return the ``CORNERS`` of a box, (8, 3), given its smallest and its largest coordinates, (2, 3)."""
    return np.asarray(box, np.float64)[CORNERS, range(3)]


def box_of(mask: NDArray[np.bool_]) -> tuple[int, int, int, int] | None:
    """Return the box (x, y, width, height) of the pixels of a mask; None if there are none."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    return int(columns[0]), int(rows[0]), int(np.ptp(columns)) + 1, int(np.ptp(rows)) + 1
