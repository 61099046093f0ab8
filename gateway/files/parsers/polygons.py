"""Triangles of polygons and of strips."""

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from mapbox_earcut import triangulate_float64
from numpy.typing import NDArray

_MIN_REFLEX: Final = 1e-4
"""Minimum sine of the angle by which a corner turns inwards: rounded corners on a straight line turn by less."""
_POLYGONS_AT_ONCE: Final = 65_536


def triangles_of_polygons(
    indices: NDArray[np.int64],
    starts: NDArray[np.int64],
    sizes: NDArray[np.int64],
    positions: NDArray[np.floating[Any]],
) -> NDArray[np.int64]:
    """Return the (M, 3) triangles of polygons, one polygon after the other: two fewer than it has corners, or none.

    Convex polygons are fans. Concave ones are cut into ears. ``starts`` and ``sizes``, (N,), are the place of the first
    vertex of each in ``indices``, and the number of its vertices. A polygon with a vertex that is not among the
    ``positions``, (V, 3), is a fan.
    """
    counts = np.maximum(sizes - 2, 0)
    first = np.repeat(starts, counts)
    second = first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(counts) - counts, counts)
    places = np.column_stack((first, second, second + 1))
    ends = np.cumsum(counts)
    for polygon, ears in ears_of_concave_polygons(indices, starts, sizes, positions):
        places[ends[polygon] - len(ears) : ends[polygon]] = starts[polygon] + ears
    triangles: NDArray[np.int64] = indices[places]
    return triangles


def ears_of_concave_polygons(
    indices: NDArray[np.int64],
    starts: NDArray[np.int64],
    sizes: NDArray[np.int64],
    positions: NDArray[np.floating[Any]],
) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield the number of each concave polygon, and its triangles, (size - 2, 3), as places in the polygon.

    Arguments are those of ``triangles_of_polygons``.
    """
    for size in np.unique(sizes[sizes > 3]).tolist():
        polygons = np.flatnonzero(sizes == size)
        for some in np.array_split(polygons, len(polygons) * size // _POLYGONS_AT_ONCE + 1):
            vertices = indices[starts[some][:, None] + np.arange(size)]
            exists = ((vertices >= 0) & (vertices < len(positions))).all(axis=1)
            corners = np.asarray(positions[vertices[exists]], np.float64)
            with np.errstate(all="ignore"):
                corners = corners - corners[:, :1]
                edges = np.roll(corners, -1, axis=1) - corners
                before = np.roll(edges, 1, axis=1)
                normals = np.cross(corners, np.roll(corners, -1, axis=1)).sum(axis=1)
                scales = np.linalg.norm(normals, axis=1)[:, None] * np.linalg.norm(edges, axis=2)
                scales *= np.linalg.norm(before, axis=2)
                turns = np.einsum("pci,pi->pc", np.cross(before, edges), normals)
                is_concave = (turns < -_MIN_REFLEX * scales).any(axis=1) & np.isfinite(scales).all(axis=1)
            for number in np.flatnonzero(is_concave).tolist():
                found = _ears(corners[number], normals[number], np.array([size]))[: size - 2]
                triangles = np.zeros((size - 2, 3), np.int64)  # corners on a line or in one place get no ear
                triangles[: len(found)] = found
                yield int(some[exists][number]), triangles


def triangles_of_rings(positions: NDArray[np.floating[Any]], sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (M, 3) triangles of a polygon with holes, as places in ``positions``.

    These are (N, 3): the corners of the outline and then of each hole, ``sizes`` of each.
    """
    if not np.isfinite(positions).all() or not 0 < sizes.sum() == len(positions):
        return np.zeros((0, 3), np.int64)
    outline = np.asarray(positions[: sizes[0]], np.float64) - positions[0]
    normal = np.cross(outline, np.roll(outline, -1, axis=0)).sum(axis=0)
    return _ears(np.asarray(positions, np.float64), normal, np.cumsum(sizes[sizes > 0]))


def _ears(corners: NDArray[np.float64], normal: NDArray[np.float64], ends: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (M, 3) triangles of an outline and its holes, (N, 3), which end before the corners ``ends``."""
    axis = int(np.abs(normal).argmax())
    plane = [(axis + 1) % 3, (axis + 2) % 3][:: 1 if normal[axis] > 0.0 else -1]
    ears = triangulate_float64(np.ascontiguousarray(corners[:, plane]), ends.astype(np.uint32))
    return ears.reshape(-1, 3).astype(np.int64)


def triangles_of_strip(strip: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (M, 3) triangles of (N,) indices. -1 starts the next strip, as in scans of Stanford."""
    place = np.arange(len(strip))
    in_strip = place - np.maximum.accumulate(np.where(strip == -1, place + 1, 0))
    triangles = np.column_stack((strip[:-2], strip[1:-1], strip[2:]))
    is_odd = in_strip[:-2] % 2 == 1
    triangles[is_odd] = triangles[is_odd][:, ::-1]
    whole: NDArray[np.int64] = triangles[(triangles != -1).all(axis=1)]
    return whole
