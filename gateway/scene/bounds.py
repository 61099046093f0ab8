"""Bounds of what is drawn: axis-aligned boxes in the world, from the vertices."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree import Node, Path
from renderers.drawlist import DrawList, Instance, Mesh

_BLOCK: Final = 1 << 19
"""Vertices transformed in one call: 12 MB, about the size of the CPU's caches."""

Bounds = NDArray[np.float64]
"""(2, 3) float64: lowest and highest corner, metres."""

EXACT_VERTICES: Final = 20_000
"""Larger meshes are replaced by the boxes of the cells of a grid. Their bounds are too large by at most one cell;
transforming a million vertices for every call would take as long as drawing them."""
_CELLS: Final = 12
"""Cells along each side of the grid. Only cells with vertices are used."""


class _Hull:
    """Points that bound a mesh under any transform."""

    __slots__ = ("box", "points")

    def __init__(self, box: Bounds | None, points: NDArray[np.float64]) -> None:
        self.box = box
        """Box in the mesh's frame; None for a mesh that draws nothing."""
        self.points = points
        """(K, 3) float64, whose convex hull contains the mesh."""


_hulls: WeakKeyDictionary[Mesh, _Hull] = WeakKeyDictionary()
_focus: WeakKeyDictionary[DrawList, tuple[Bounds | None]] = WeakKeyDictionary()
_lock = threading.Lock()


def mesh_bounds(mesh: Mesh) -> Bounds | None:
    """Return the box of the vertices in use, in the mesh's frame; None for a mesh that draws nothing."""
    return _hull_of(mesh).box


def _hull_of(mesh: Mesh) -> _Hull:
    with _lock:
        found = _hulls.get(mesh)
    if found is None:
        found = _measure(mesh)
        with _lock:
            found = _hulls.setdefault(mesh, found)
    return found


def _measure(mesh: Mesh) -> _Hull:
    used = np.zeros(len(mesh.positions), dtype=np.bool_)
    used[mesh.elements.ravel()] = True
    points = mesh.positions[used].astype(np.float64)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        return _Hull(None, points)
    box = np.array((points.min(axis=0), points.max(axis=0)))
    return _Hull(box, points if len(points) <= EXACT_VERTICES else _cell_corners(points, box))


def _cell_corners(points: NDArray[np.float64], box: Bounds) -> NDArray[np.float64]:
    """Return the corners of the boxes of the points in each cell of a grid, (K, 3)."""
    extent = box[1] - box[0]
    scale = np.divide(_CELLS * 0.999999, extent, out=np.zeros(3), where=extent > 0)
    cell = ((points - box[0]) * scale).astype(np.int64) @ (1, _CELLS, _CELLS * _CELLS)
    order = np.argsort(cell, kind="stable")
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    low = np.minimum.reduceat(points[order], starts, axis=0)
    high = np.maximum.reduceat(points[order], starts, axis=0)
    corners: NDArray[np.float64] = _corners(np.stack((low, high), axis=1)).reshape(-1, 3)
    return corners


_CORNERS: Final = np.array([[(k >> axis) & 1 for axis in range(3)] for k in range(8)])


def _corners(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the corners of (N, 2, 3) boxes, (N, 8, 3)."""
    picked: NDArray[np.float64] = np.take_along_axis(boxes, np.broadcast_to(_CORNERS, (len(boxes), 8, 3)), axis=1)
    return picked


def corners_of(bounds: Bounds) -> NDArray[np.float64]:
    """Return the corners of a box, (8, 3) float64."""
    eight: NDArray[np.float64] = _corners(bounds[None])[0]
    return eight


def _placed(hull: _Hull, X_world_mesh: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the boxes of one mesh under (N, 4, 4) transforms, (N, 2, 3); None for a mesh that draws nothing."""
    if hull.box is None:
        return None
    linear, offset = X_world_mesh[:, :3, :3], X_world_mesh[:, :3, 3]
    out = np.empty((len(linear), 2, 3))
    # For rotations by quarter turns, the transformed box is the box of the transformed vertices.
    aligned = (np.count_nonzero(linear, axis=2) <= 1).all(axis=1)
    for which, points in ((np.flatnonzero(aligned), hull.box), (np.flatnonzero(~aligned), hull.points)):
        step = max(1, _BLOCK // len(points))
        for begin in range(0, len(which), step):
            some = which[begin : begin + step]
            moved = (linear[some].reshape(-1, 3) @ points.T).reshape(len(some), 3, -1)
            out[some, 0], out[some, 1] = moved.min(axis=2), moved.max(axis=2)
    out += offset[:, None, :]
    return out


def instance_bounds(instances: Sequence[Instance]) -> list[Bounds | None]:
    """Return the box of each instance in the world; None for an instance that draws nothing."""
    of_mesh: dict[Mesh, list[int]] = {}
    for index, instance in enumerate(instances):
        of_mesh.setdefault(instance.mesh, []).append(index)
    out: list[Bounds | None] = [None] * len(instances)
    for mesh, indices in of_mesh.items():
        boxes = _placed(_hull_of(mesh), np.array([instances[index].X_world_mesh for index in indices]))
        if boxes is not None:
            for index, box in zip(indices, boxes, strict=True):
                out[index] = box
    return out


def union(boxes: list[Bounds]) -> Bounds | None:
    """Return the box around boxes; None where there are none."""
    if not boxes:
        return None
    stacked = np.array(boxes)
    return np.array((stacked[:, 0].min(axis=0), stacked[:, 1].max(axis=0)))


class BoundsCache:
    """Boxes of the instances of the last draw list, for the next one, which shares most of them. Not thread-safe."""

    def __init__(self) -> None:
        self._known: dict[int, tuple[Instance, Bounds | None]] = {}

    def bounds_of(self, drawn: DrawList) -> list[Bounds | None]:
        """Return the box of each instance in the world; None for an instance that draws nothing."""
        known = self._known
        missing = [i for i in drawn.instances if id(i) not in known or known[id(i)][0] is not i]
        measured = {id(i): (i, box) for i, box in zip(missing, instance_bounds(missing), strict=True)}
        self._known = {id(i): measured.get(id(i)) or known[id(i)] for i in drawn.instances}
        return [self._known[id(i)][1] for i in drawn.instances]


def scene_bounds(drawn: DrawList) -> Bounds | None:
    """Return the box around all instances."""
    return union([box for box in instance_bounds(drawn.instances) if box is not None])


def loose_bounds(drawn: DrawList) -> Bounds | None:
    """Return a box that contains all instances, up to 1.8 times too large, at a hundredth of the cost."""
    boxed = [(box, i.X_world_mesh) for i in drawn.instances if (box := mesh_bounds(i.mesh)) is not None]
    if not boxed:
        return None
    X = np.array([X for _, X in boxed])
    moved = (
        np.matmul(_corners(np.array([box for box, _ in boxed])), X[:, :3, :3].transpose(0, 2, 1)) + X[:, None, :3, 3]
    )
    return np.array((moved.min(axis=(0, 1)), moved.max(axis=(0, 1))))


def focus_bounds(drawn: DrawList) -> Bounds | None:
    """Return the box around everything but grounds and walls much larger than the rest.

    A ground is an instance whose thinnest side is below 1 % of its longest, and whose longest is more than 1.5 times
    the diagonal of everything that is not flat. The result is kept while the draw list lives, for further cameras.
    """
    with _lock:
        known = _focus.get(drawn)
    if known is None:
        known = (_focus_bounds(drawn),)
        with _lock:
            _focus[drawn] = known
    return known[0]


def _focus_bounds(drawn: DrawList) -> Bounds | None:
    boxes = [box for box in instance_bounds(drawn.instances) if box is not None]
    extents = [box[1] - box[0] for box in boxes]
    solid = union([box for box, extent in zip(boxes, extents, strict=True) if extent.min() >= 0.01 * extent.max()])
    if solid is None:
        return union(boxes)
    reach = 1.5 * float(np.linalg.norm(solid[1] - solid[0]))
    return union(
        [
            box
            for box, extent in zip(boxes, extents, strict=True)
            if extent.min() >= 0.01 * extent.max() or extent.max() <= reach
        ]
    )


def world_matrix(root: Node, path: Path) -> NDArray[np.float64] | None:
    """Return X_world_node, (4, 4) float64, the product of all transforms from the root; None without such a node."""
    node: Node | None = root
    with np.errstate(all="ignore"):
        world = root.matrix
        for element in path:
            node = node.children.get(element) if node is not None else None
            if node is None:
                return None
            world = world @ node.matrix
    return world
