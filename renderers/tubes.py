"""A tube along a polyline as one mesh: mitred at gentle bends, with a ball at sharp ones, capped at the ends."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import Mesh
from renderers.primitives import Triangles, Vertices, circle, fan, frozen_mesh, sphere

TUBE_SIDES: Final = 24
"""As Director's tube filter."""
VERTEX_BUDGET: Final = 400_000
"""Long lines get fewer sides, so that the rings of a tube stay within this many vertices (about 10 MB)."""
MIN_SIDES: Final = 6
SMOOTH_COSINE: Final = 0.9
"""A joint is shaded as one smooth surface while the cosine of its bend is above this (26 degrees)."""
MITRE_COSINE: Final = -0.1
"""A joint is mitred while the cosine of its bend is above this (96 degrees), where the mitre sticks out by at most
1 / cos(48 deg) = 1.49 radii; beyond, each side ends square and a ball fills the joint."""


def clean_polyline(points: NDArray[np.floating], limit: float, *, closed: bool) -> NDArray[np.float64]:
    """(N, 3) float64: without points beyond ``limit`` (or non-finite) and without repeats of the point before."""
    kept = np.asarray(points, dtype=np.float64)
    kept = kept[(np.abs(kept) < limit).all(axis=1)]
    if len(kept) > 1:
        # A step below float32's resolution of the coordinates has no direction worth drawing.
        tiny = 1e-7 * max(float(np.abs(kept).max()), 1e-5)
        distinct = np.ones(len(kept), dtype=np.bool_)
        distinct[1:] = np.abs(np.diff(kept, axis=0)).max(axis=1) > tiny
        kept = kept[distinct]
        if closed and len(kept) > 1 and np.abs(kept[0] - kept[-1]).max() <= tiny:
            kept = kept[:-1]
    return kept


def tube(points: NDArray[np.float64], radius: float, *, closed: bool = False) -> Mesh | None:
    """The surface of a tube, outward normals, wound counter-clockwise from outside.

    Args:
        points: (N, 3) float64, a ``clean_polyline``.
        radius: metres, > 0.
        closed: joins the last point to the first.
    Returns:
        None when there is nothing to draw (fewer than two points) or when the line is so long that even a tube of
        ``MIN_SIDES`` would exceed ``VERTEX_BUDGET``: draw a hairline then.
    """
    count = len(points)
    closed = closed and count > 2
    if count < 2 or count * MIN_SIDES > VERTEX_BUDGET:
        return None
    sides = max(MIN_SIDES, min(TUBE_SIDES, VERTEX_BUDGET // count))
    directions = np.roll(points, -1, axis=0) - points
    directions = directions if closed else directions[:-1]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before = np.roll(directions, 1, axis=0)
    bend = (before * directions).sum(axis=1)
    if not closed:
        bend[0] = -1.0
    mitred, smooth = bend > MITRE_COSINE, bend > SMOOTH_COSINE
    frames = _transported_frames(directions, mitred)
    around = circle(sides)
    across = np.cross(directions, frames)
    offsets = around[None, :, :1] * frames[:, None, :] + around[None, :, 1:] * across[:, None, :]

    # One ring at the start of every segment, which a smooth joint shares with the segment before it, and one at the end
    # of every segment whose end is not smooth.
    bisectors = np.where(mitred[:, None], before + directions, directions)
    bisectors /= np.linalg.norm(bisectors, axis=1, keepdims=True)
    parted = np.flatnonzero(~np.roll(smooth, -1))
    following = (parted + 1) % len(directions)
    planes = np.where(mitred[following][:, None], bisectors[following], directions[parted])
    starts = _slid(offsets, directions, bisectors)
    rings = points[: len(directions), None, :] + radius * starts
    ends = points[(parted + 1) % count, None, :] + radius * _slid(offsets[parted], directions[parted], planes)
    # Two neighbours' offsets are mirror images in the mitre plane: their mean is the part within the plane.
    normals = np.where(smooth[:, None, None], _within(offsets, bisectors), offsets)

    index = np.arange((len(rings) + len(ends)) * sides).reshape(-1, sides)
    upper = np.roll(index[: len(directions)], -1, axis=0)
    if smooth[0]:
        upper[-1] = np.roll(upper[-1], -_closing_shift(directions, frames, sides))
    upper[parted] = index[len(directions) :]
    pieces = _Pieces()
    pieces.add(
        np.concatenate((rings, ends)).reshape(-1, 3),
        np.concatenate((normals, offsets[parted])).reshape(-1, 3),
        _bands(index[: len(directions)], upper),
    )
    if not closed:
        pieces.add(*_cap(rings[0], points[0], -directions[0], up=False))
        pieces.add(*_cap(ends[-1], points[-1], directions[-1], up=True))
    sharp = np.flatnonzero(~mitred)
    _add_balls(pieces, points[sharp if closed else sharp[1:]], radius)
    return pieces.mesh()


def _slid(
    offsets: NDArray[np.float64], directions: NDArray[np.float64], planes: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(S, sides, 3): the offsets moved along their segments into the planes with these normals."""
    distance = np.einsum("skc,sc->sk", offsets, planes) / np.einsum("sc,sc->s", directions, planes)[:, None]
    slid: NDArray[np.float64] = offsets - distance[:, :, None] * directions[:, None, :]
    return slid


def _within(offsets: NDArray[np.float64], planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(S, sides, 3): unit vectors along the offsets' projections into the planes with these normals."""
    projected = offsets - np.einsum("skc,sc->sk", offsets, planes)[:, :, None] * planes[:, None, :]
    normalized: NDArray[np.float64] = projected / np.linalg.norm(projected, axis=2, keepdims=True)
    return normalized


def _transported_frames(directions: NDArray[np.float64], mitred: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(S, 3): a unit vector across each segment, carried over mitred joints by the smallest rotation.

    With this rotation the rings of two neighbours, each slid along its segment onto the mitre plane, coincide.
    Plain floats: numpy would pay a microsecond per operation on three numbers.
    """
    out: list[tuple[float, float, float]] = []
    ux = uy = uz = px = py = pz = 0.0
    for (dx, dy, dz), carry in zip(directions.tolist(), mitred.tolist(), strict=True):
        if carry and out:
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
        out.append((ux, uy, uz))
    return np.array(out)


def _closing_shift(directions: NDArray[np.float64], frames: NDArray[np.float64], sides: int) -> int:
    """By how many sides the frame carried once around a closed line is turned against the first one.

    Less than half a side of twist is left; the last segment takes it.
    """
    last, first, u = directions[-1], directions[0], frames[-1]
    carried = u - (u @ first) / (1.0 + last @ first) * (last + first)
    angle = math.atan2(float(np.cross(frames[0], carried) @ first), float(frames[0] @ carried))
    return round(angle * sides / (2.0 * math.pi))


def _bands(lower: NDArray[np.int64], upper: NDArray[np.int64]) -> Triangles:
    """(S * sides * 2, 3): ``primitives.band`` for many pairs of rings (S, sides) at once."""
    next_lower, next_upper = np.roll(lower, -1, axis=1), np.roll(upper, -1, axis=1)
    return np.stack((lower, next_lower, next_upper, lower, next_upper, upper), axis=2).reshape(-1, 3)


def _cap(
    ring: NDArray[np.float64], centre: NDArray[np.float64], normal: NDArray[np.float64], *, up: bool
) -> tuple[Vertices, Vertices, Triangles]:
    positions = np.concatenate((ring, centre[None]))
    return positions, np.tile(normal, (len(positions), 1)), fan(len(ring), np.arange(len(ring)), up=up)


def _add_balls(pieces: _Pieces, centres: NDArray[np.float64], radius: float) -> None:
    """Balls at sharp joints, coarser the more there are."""
    if not len(centres):
        return
    ball = sphere(TUBE_SIDES, 12) if len(centres) <= 256 else sphere(12, 6) if len(centres) <= 4096 else sphere(8, 4)
    unit = ball.positions.astype(np.float64)
    positions = (centres[:, None, :] + radius * unit).reshape(-1, 3)
    first = np.arange(len(centres), dtype=np.int64)[:, None, None] * len(unit)
    pieces.add(positions, np.tile(unit, (len(centres), 1)), (ball.elements[None] + first).reshape(-1, 3))


class _Pieces:
    """Vertices and triangles gathered into one mesh."""

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
