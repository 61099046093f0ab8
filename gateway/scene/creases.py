"""Normals for meshes that come without: smooth, but not across creases."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import Mesh

CREASE_ANGLE: Final = math.radians(45.0)
"""Faces that meet at a larger angle are shaded apart (Director's feature angle)."""
_MAX_FACES: Final = 512
"""At a vertex; beyond, its faces are shaded flat, since the work grows with the square of this number."""
_PAIRS: Final = 1 << 20
"""Pairs of faces at a vertex that are compared in one numpy call; bounds the memory to some 100 MB."""


def with_creases(
    positions: NDArray[np.float32],
    triangles: NDArray[np.uint32],
    *,
    uv: NDArray[np.float32] | None = None,
    colors: NDArray[np.float32] | None = None,
    angle: float = CREASE_ANGLE,
) -> Mesh:
    """A mesh with unit normals; vertices at creases are split, equal ones merged.

    A corner's normal is the mean, weighted by the faces' angles at the vertex, of the normals of those faces around it
    that meet its own face at less than ``angle``. (Weights by angle do not depend on how a polygon was cut into
    triangles: Thuermer and Wuethrich, Computing Vertex Normals from Polygonal Facets, 1998.) Vertices count as the same
    when their positions are equal, as in STL files.

    Args:
        positions: (N, 3) float32.
        triangles: (M, 3) uint32.
        uv: (N, 2) float32 or None.
        colors: (N, 4) float32 or None.
        angle: radians.
    """
    corners = triangles.astype(np.int64).ravel()
    if not len(corners):
        return Mesh(positions, triangles, uv0=uv, colors=colors)
    used = positions[corners].astype(np.float64).reshape(-1, 3, 3)
    with np.errstate(all="ignore"):
        area = np.cross(used[:, 1] - used[:, 0], used[:, 2] - used[:, 0])
        length = np.linalg.norm(area, axis=1)
        flat = np.where((length > 0.0)[:, None], area / length[:, None], 0.0)
    place = _places(positions)[corners]
    normals = _corner_normals(place, flat, _corner_angles(used), math.cos(angle))

    apart = corners if uv is not None or colors is not None else place
    key = np.column_stack((apart, np.round(normals * 4096.0).astype(np.int64)))
    _, first, index = np.unique(key, axis=0, return_index=True, return_inverse=True)
    source = corners[first]
    return Mesh(
        np.ascontiguousarray(positions[source]),
        np.ascontiguousarray(index.reshape(-1, 3), dtype=np.uint32),
        normals=np.ascontiguousarray(normals[first], dtype=np.float32),
        uv0=None if uv is None else np.ascontiguousarray(uv[source]),
        colors=None if colors is None else np.ascontiguousarray(colors[source]),
    )


def _places(positions: NDArray[np.float32]) -> NDArray[np.int64]:
    """(N,) the same number for equal positions."""
    rows = np.ascontiguousarray(positions + np.float32(0.0)).view(np.dtype((np.void, 12))).ravel()
    _, index = np.unique(rows, return_inverse=True)
    return index.astype(np.int64).ravel()


def _corner_angles(triangles: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3 M,) radians: the angle of each triangle of (M, 3, 3) at each of its corners; 0 where it has none."""
    forward = np.roll(triangles, -1, axis=1) - triangles
    backward = np.roll(triangles, 1, axis=1) - triangles
    with np.errstate(all="ignore"):
        sine = np.linalg.norm(np.cross(forward, backward), axis=2)
        angle = np.arctan2(sine, (forward * backward).sum(axis=2)).ravel()
    return np.where(np.isfinite(angle), angle, 0.0)


def _corner_normals(
    place: NDArray[np.int64], flat: NDArray[np.float64], angles: NDArray[np.float64], cosine: float
) -> NDArray[np.float64]:
    """(3 M, 3): a unit normal a corner; ``place`` and ``angles`` are (3 M,), ``flat`` is (M, 3) by face."""
    normals = np.repeat(flat, 3, axis=0)
    order = np.argsort(place, kind="stable")
    starts = np.flatnonzero(np.diff(place[order], prepend=-1))
    counts = np.diff(starts, append=len(order))
    shared = (counts > 1) & (counts <= _MAX_FACES)
    starts, counts = starts[shared], counts[shared]
    pairs = np.cumsum(counts * counts)
    begin = 0
    while begin < len(starts):
        done = int(pairs[begin - 1]) if begin else 0
        end = max(begin + 1, int(np.searchsorted(pairs, done + _PAIRS)))
        n = np.repeat(counts[begin:end], counts[begin:end])
        start = np.repeat(starts[begin:end], counts[begin:end])
        within = np.arange(len(n)) - np.repeat(np.cumsum(counts[begin:end]) - counts[begin:end], counts[begin:end])
        mine = order[start + within]
        offsets = np.cumsum(n) - n
        partner = order[np.repeat(start, n) + np.arange(int(n.sum())) - np.repeat(offsets, n)]
        face, other = np.repeat(mine // 3, n), partner // 3
        near = (flat[face] * flat[other]).sum(axis=1) > cosine
        total = np.add.reduceat(flat[other] * np.where(near, angles[partner], 0.0)[:, None], offsets, axis=0)
        length = np.linalg.norm(total, axis=1)
        good = length > 0.0
        normals[mine[good]] = total[good] / length[good, None]
        begin = end
    return normals
