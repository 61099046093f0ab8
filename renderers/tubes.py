"""Meshes of tubes along polylines: mitre joints at gentle bends, balls at sharp ones, caps at the ends."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import Mesh
from renderers.primitives import Triangles, Vertices, band, circle, fan, frozen_mesh, sphere

TUBE_SIDES: Final = 24
"""Sides of a tube, as in Director's tube filter."""
VERTEX_BUDGET: Final = 400_000
"""Maximum number of ring vertices of a tube (about 10 MB). Long lines get fewer sides."""
MIN_SIDES: Final = 6
"""Minimum number of sides. Lines that are too long for this number get no tube."""
SMOOTH_COSINE: Final = 0.9
"""Minimum cosine of the bend of a joint with smooth normals (26 degrees)."""
MITRE_COSINE: Final = -0.1
"""Minimum cosine of the bend of a mitre joint (96 degrees, where the mitre extends to 1 / cos(48 deg) = 1.49 radii). At
sharper bends both segments end square, and a ball fills the joint."""


def clean_polyline(points: NDArray[np.floating], limit: float, *, closed: bool) -> NDArray[np.float64]:
    """Return the usable points of a polyline, (N, 3) float64.

    Points with a coordinate that is not finite or at least ``limit`` metres, and consecutive duplicates, are dropped.
    If ``closed``, the last point is dropped if it equals the first one.
    """
    clean = np.asarray(points, dtype=np.float64)
    clean = clean[(np.abs(clean) < limit).all(axis=1)]
    if len(clean) > 1:
        # A step below float32's resolution of the coordinates has no usable direction.
        min_step = 1e-7 * max(float(np.abs(clean).max()), 1e-5)
        is_distinct = np.ones(len(clean), dtype=np.bool_)
        is_distinct[1:] = np.abs(np.diff(clean, axis=0)).max(axis=1) > min_step
        clean = clean[is_distinct]
        if closed and len(clean) > 1 and np.abs(clean[0] - clean[-1]).max() <= min_step:
            clean = clean[:-1]
    return clean


def tube(points: NDArray[np.float64], radius: float, *, closed: bool = False) -> Mesh | None:
    """Return the surface of a tube with outward normals, wound counter-clockwise from outside.

    Args:
        points: (N, 3) float64, metres, from ``clean_polyline``.
        radius: metres, > 0.
        closed: connect the last point to the first.

    Returns:
        None for fewer than two points, and for lines whose tube of ``MIN_SIDES`` would exceed ``VERTEX_BUDGET``.
    """
    count = len(points)
    closed = closed and count > 2
    if count < 2 or count * MIN_SIDES > VERTEX_BUDGET:
        return None
    sides = max(MIN_SIDES, min(TUBE_SIDES, VERTEX_BUDGET // count))
    directions = np.roll(points, -1, axis=0) - points
    directions = directions if closed else directions[:-1]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    previous_directions = np.roll(directions, 1, axis=0)
    bend_cosines = (previous_directions * directions).sum(axis=1)
    if not closed:
        bend_cosines[0] = -1.0
    mitred, smooth = bend_cosines > MITRE_COSINE, bend_cosines > SMOOTH_COSINE
    frames = _transported_frames(directions, mitred)
    around = circle(sides)
    perpendiculars = np.cross(directions, frames)
    offsets = around[None, :, :1] * frames[:, None, :] + around[None, :, 1:] * perpendiculars[:, None, :]

    # Every segment has a ring at its start. At a smooth joint, that ring is also the end of the previous segment. A
    # segment whose end is not smooth has a second ring there.
    bisectors = np.where(mitred[:, None], previous_directions + directions, directions)
    bisectors /= np.linalg.norm(bisectors, axis=1, keepdims=True)
    with_end_ring = np.flatnonzero(~np.roll(smooth, -1))
    next_segment = (with_end_ring + 1) % len(directions)
    end_planes = np.where(mitred[next_segment][:, None], bisectors[next_segment], directions[with_end_ring])
    start_offsets = _projected_along(offsets, directions, bisectors)
    start_rings = points[: len(directions), None, :] + radius * start_offsets
    end_rings = points[(with_end_ring + 1) % count, None, :] + radius * _projected_along(
        offsets[with_end_ring], directions[with_end_ring], end_planes
    )
    # The offsets of neighbouring segments are mirror images in the mitre plane: their mean is their part in the plane.
    normals = np.where(smooth[:, None, None], _unit_within(offsets, bisectors), offsets)

    index = np.arange((len(start_rings) + len(end_rings)) * sides).reshape(-1, sides)
    end_index = np.roll(index[: len(directions)], -1, axis=0)
    if smooth[0]:
        end_index[-1] = np.roll(end_index[-1], -_closing_shift(directions, frames, sides))
    end_index[with_end_ring] = index[len(directions) :]
    builder = _MeshBuilder()
    builder.add(
        np.concatenate((start_rings, end_rings)).reshape(-1, 3),
        np.concatenate((normals, offsets[with_end_ring])).reshape(-1, 3),
        band(index[: len(directions)], end_index),
    )
    if not closed:
        builder.add(*_cap(start_rings[0], points[0], -directions[0], up=False))
        builder.add(*_cap(end_rings[-1], points[-1], directions[-1], up=True))
    sharp = np.flatnonzero(~mitred)
    _add_balls(builder, points[sharp if closed else sharp[1:]], radius)
    return builder.mesh()


def _projected_along(
    offsets: NDArray[np.float64], directions: NDArray[np.float64], planes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the offsets, moved along their segments into planes, (S, sides, 3); ``planes``: (S, 3) normals."""
    distance = np.einsum("skc,sc->sk", offsets, planes) / np.einsum("sc,sc->s", directions, planes)[:, None]
    moved: NDArray[np.float64] = offsets - distance[:, :, None] * directions[:, None, :]
    return moved


def _unit_within(offsets: NDArray[np.float64], planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit projections of the offsets into planes, (S, sides, 3); ``planes``: (S, 3) unit normals."""
    projected = offsets - np.einsum("skc,sc->sk", offsets, planes)[:, :, None] * planes[:, None, :]
    normalized: NDArray[np.float64] = projected / np.linalg.norm(projected, axis=2, keepdims=True)
    return normalized


def _transported_frames(directions: NDArray[np.float64], mitred: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return a unit vector u perpendicular to each segment, (S, 3).

    Over mitre joints, u is transported by the smallest rotation, so that the rings of neighbouring segments coincide on
    the mitre plane. (dx, dy, dz) is a segment's direction, (px, py, pz) that of the previous one. The loop uses plain
    floats, since NumPy takes a microsecond per operation on three numbers.
    """
    frames: list[tuple[float, float, float]] = []
    ux = uy = uz = px = py = pz = 0.0
    for (dx, dy, dz), is_mitred in zip(directions.tolist(), mitred.tolist(), strict=True):
        if is_mitred and frames:
            factor = (ux * dx + uy * dy + uz * dz) / (1.0 + px * dx + py * dy + pz * dz)
            ux, uy, uz = ux - factor * (px + dx), uy - factor * (py + dy), uz - factor * (pz + dz)
        elif abs(dz) < 0.9:
            ux, uy, uz = -dy, dx, 0.0
        else:
            ux, uy, uz = dz, 0.0, -dx
        along = ux * dx + uy * dy + uz * dz
        ux, uy, uz = ux - along * dx, uy - along * dy, uz - along * dz
        length = math.sqrt(ux * ux + uy * uy + uz * uz)
        ux, uy, uz = ux / length, uy / length, uz / length
        px, py, pz = dx, dy, dz
        frames.append((ux, uy, uz))
    return np.array(frames)


def _closing_shift(directions: NDArray[np.float64], frames: NDArray[np.float64], sides: int) -> int:
    """Return the number of sides by which the first frame turns when it is transported around a closed line, rounded.

    The last segment is twisted by the rounding error, at most half a side.
    """
    last, first, u = directions[-1], directions[0], frames[-1]
    transported = u - (u @ first) / (1.0 + last @ first) * (last + first)
    angle = math.atan2(float(np.cross(frames[0], transported) @ first), float(frames[0] @ transported))
    return round(angle * sides / (2.0 * math.pi))


def _cap(
    ring: NDArray[np.float64], centre: NDArray[np.float64], normal: NDArray[np.float64], *, up: bool
) -> tuple[Vertices, Vertices, Triangles]:
    """Return positions, normals and triangles of a disc that closes a ring; ``up`` as in ``fan``."""
    positions = np.concatenate((ring, centre[None]))
    return positions, np.tile(normal, (len(positions), 1)), fan(len(ring), np.arange(len(ring)), up=up)


def _add_balls(builder: _MeshBuilder, centres: NDArray[np.float64], radius: float) -> None:
    """Add a ball at each sharp joint. If there are many, the balls are coarser."""
    if not len(centres):
        return
    ball = sphere(TUBE_SIDES, 12) if len(centres) <= 256 else sphere(12, 6) if len(centres) <= 4096 else sphere(8, 4)
    unit = ball.positions.astype(np.float64)
    positions = (centres[:, None, :] + radius * unit).reshape(-1, 3)
    first_vertex = np.arange(len(centres), dtype=np.int64)[:, None, None] * len(unit)
    builder.add(positions, np.tile(unit, (len(centres), 1)), (ball.elements[None] + first_vertex).reshape(-1, 3))


class _MeshBuilder:
    """Concatenates vertices and triangles of several parts."""

    def __init__(self) -> None:
        self._count = 0
        self._positions: list[Vertices] = []
        self._normals: list[Vertices] = []
        self._triangles: list[Triangles] = []

    def add(self, positions: Vertices, normals: Vertices, triangles: Triangles) -> None:
        self._positions.append(positions)
        self._normals.append(normals)
        self._triangles.append(triangles + self._count)
        self._count += len(positions)

    def mesh(self) -> Mesh:
        return frozen_mesh(
            np.concatenate(self._positions), np.concatenate(self._triangles), np.concatenate(self._normals)
        )
