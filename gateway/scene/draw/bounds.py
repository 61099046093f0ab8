"""Axis-aligned bounding boxes of meshes, instances and scenes."""

from collections.abc import Sequence
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.weak_memo import cached_by_weak_key
from renderers.drawlist import DrawList, Instance, Mesh

Bounds = NDArray[np.float64]
"""(2, 3) float64: lowest and highest corner, metres."""

EXACT_VERTICES: Final = 20_000
"""Maximum number of vertices of a mesh with exact bounds. Those of a larger mesh come from the cells of a grid that
have vertices: they are too large by at most one cell. Transforming a million vertices for every call would take as long
as drawing them."""
_CELLS_PER_SIDE: Final = 12
"""Number of cells of that grid along each axis."""
_CHUNK_VERTICES: Final = 1 << 19
"""Number of vertices transformed in one call: 12 MB, about the size of the CPU's caches."""
_CORNER_INDEX: Final = np.array([[(corner >> axis) & 1 for axis in range(3)] for corner in range(8)])
"""(8, 3): index into ``Bounds`` of each corner's coordinate along each axis, 0 for the lowest and 1 for the highest."""
MIN_SUSPECT: Final = 100.0
"""Minimum length of a scene that may be in millimetres, metres."""
_FLAT_RATIO: Final = 0.01
"""Maximum ratio of the shortest to the longest side of a flat box."""
_GROUND_RATIO: Final = 1.5
"""Minimum length of a ground or wall, as a multiple of the diagonal of the box around all shapes that are not flat."""


class _Hull:
    """Points that bound a mesh under any affine transform."""

    def __init__(self, mesh: Mesh) -> None:
        is_used = np.zeros(len(mesh.positions), dtype=np.bool_)
        is_used[mesh.elements.ravel()] = True
        self._vertices = mesh.positions if is_used.all() else mesh.positions[is_used]
        self.box = _box_of(self._vertices)
        """Box in the mesh's frame; None for a mesh that draws nothing."""

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """(K, 3) float64, in the mesh's frame. Their convex hull contains the mesh, which must draw something.

        Computed at the first use: meshes whose axes stay aligned with the world's need only the box.
        """
        assert self.box is not None
        finite = _finite_rows(self._vertices)
        return finite.astype(np.float64) if len(finite) <= EXACT_VERTICES else _grid_corners(finite, self.box)


_hull_of = cached_by_weak_key(_Hull)


def mesh_bounds(mesh: Mesh) -> Bounds | None:
    """Return the box of the vertices in use, in the mesh's frame; None for a mesh that draws nothing."""
    return _hull_of(mesh).box


def _box_of(vertices: NDArray[np.float32]) -> Bounds | None:
    """Return the box of the finite vertices, (N, 3); None if there are none."""
    if not len(vertices):
        return None
    # One column at a time: NumPy takes twenty times as long along the first axis of an array of three columns.
    columns = vertices.T
    box = np.array([[column.min() for column in columns], [column.max() for column in columns]], np.float64)
    return box if np.isfinite(box).all() else _box_of(_finite_rows(vertices))  # rare: it copies the vertices


def _finite_rows(vertices: NDArray[np.float32]) -> NDArray[np.float32]:
    return vertices[np.isfinite(vertices).all(axis=1)]


def _grid_corners(points: NDArray[np.float32], box: Bounds) -> NDArray[np.float64]:
    """Return the corners of those cells of a grid in the box that have points, (K, 3) float64."""
    cell_size = (box[1] - box[0]) / _CELLS_PER_SIDE
    cells_per_metre = np.divide(1.0, cell_size, out=np.zeros(3), where=cell_size > 0)
    is_occupied = np.zeros((_CELLS_PER_SIDE,) * 3, np.bool_)
    for begin in range(0, len(points), _CHUNK_VERTICES):
        cells = ((points[begin : begin + _CHUNK_VERTICES] - box[0]) * cells_per_metre).astype(np.int64)
        is_occupied[tuple(np.minimum(cells, _CELLS_PER_SIDE - 1).T)] = True
    occupied_cells = np.argwhere(is_occupied)
    cell_boxes = box[0] + cell_size * np.stack((occupied_cells, occupied_cells + 1), axis=1)
    return corners_of(np.clip(cell_boxes, *box)).reshape(-1, 3)


def corners_of(bounds: Bounds) -> NDArray[np.float64]:
    """Return the corners of a box, (8, 3) float64, or of many, (N, 8, 3) for (N, 2, 3)."""
    axes = np.arange(3)
    corners: NDArray[np.float64] = bounds[..., _CORNER_INDEX, axes]
    return corners


def _transformed_boxes(hull: _Hull, X_world_mesh: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Return the world boxes of a mesh at N poses, (N, 4, 4), as (N, 2, 3); None for a mesh that draws nothing."""
    if hull.box is None:
        return None
    linear, offset = X_world_mesh[:, :3, :3], X_world_mesh[:, :3, 3]
    boxes = np.empty((len(linear), 2, 3))
    maps_axes_to_axes = (np.count_nonzero(linear, axis=2) <= 1).all(axis=1)
    if maps_axes_to_axes.any():  # two opposite corners of the box are enough for these
        boxes[maps_axes_to_axes] = _mapped_boxes(linear[maps_axes_to_axes], hull.box)
    if not maps_axes_to_axes.all():
        boxes[~maps_axes_to_axes] = _mapped_boxes(linear[~maps_axes_to_axes], hull.points)
    return boxes + offset[:, None, :]


def _mapped_boxes(linear: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the box of K points, (K, 3), under each of N linear maps, (N, 3, 3), as (N, 2, 3)."""
    boxes = np.empty((len(linear), 2, 3))
    step = max(1, _CHUNK_VERTICES // len(points))
    for begin in range(0, len(linear), step):
        maps = linear[begin : begin + step]
        mapped = (maps.reshape(-1, 3) @ points.T).reshape(len(maps), 3, len(points))
        boxes[begin : begin + step] = np.stack((mapped.min(axis=2), mapped.max(axis=2)), axis=1)
    return boxes


def _instance_boxes(instances: Sequence[Instance]) -> NDArray[np.float64]:
    """Return the box of each instance in the world, (N, 2, 3); NaN for an instance that draws nothing."""
    indices_by_mesh: dict[Mesh, list[int]] = {}
    for index, instance in enumerate(instances):
        indices_by_mesh.setdefault(instance.mesh, []).append(index)
    all_boxes = np.full((len(instances), 2, 3), np.nan)
    for mesh, indices in indices_by_mesh.items():
        boxes = _transformed_boxes(_hull_of(mesh), np.array([instances[index].X_world_mesh for index in indices]))
        if boxes is not None:
            all_boxes[indices] = boxes
    return all_boxes


def instance_bounds(instances: Sequence[Instance]) -> list[Bounds | None]:
    """Return the box of each instance in the world; None for an instance that draws nothing."""
    boxes = _instance_boxes(instances)
    return [None if is_empty else box for box, is_empty in zip(boxes, np.isnan(boxes[:, 0, 0]).tolist(), strict=True)]


def scale_hint(bounds: Bounds) -> str:
    """Return how much a scene spans, with ``--scale`` for what may be in millimetres."""
    span = float((bounds[1] - bounds[0]).max())
    length = f"{span / 1000.0:.3g} km" if span >= 1000.0 else f"{span:.3g} m"
    return f"the scene spans {length}" + ("; --scale 0.001, if it is in millimetres" if span >= MIN_SUSPECT else "")


def union(boxes: Sequence[Bounds] | NDArray[np.float64]) -> Bounds | None:
    """Return the box around all boxes; None if there are none."""
    if not len(boxes):
        return None
    stacked = np.asarray(boxes)
    return np.array((stacked[:, 0].min(axis=0), stacked[:, 1].max(axis=0)))


def loose_bounds(draw_list: DrawList) -> Bounds | None:
    """Return a box that contains all instances, in a hundredth of the time of ``instance_bounds``.

    It contains the transformed boxes of the meshes instead of their vertices. That of a rotated sphere has sides of up
    to sqrt(3) times the sphere's diameter.
    """
    box_by_mesh = {mesh: mesh_bounds(mesh) for mesh in {instance.mesh for instance in draw_list.instances}}
    drawn = [instance for instance in draw_list.instances if box_by_mesh[instance.mesh] is not None]
    if not drawn:
        return None
    mesh_corners = corners_of(np.array([box_by_mesh[instance.mesh] for instance in drawn]))
    X_world_mesh = np.array([instance.X_world_mesh for instance in drawn])
    corners = np.matmul(mesh_corners, X_world_mesh[:, :3, :3].transpose(0, 2, 1)) + X_world_mesh[:, None, :3, 3]
    return np.array((corners.min(axis=(0, 1)), corners.max(axis=(0, 1))))


@cached_by_weak_key
def focus_bounds(draw_list: DrawList) -> Bounds | None:
    """Return the box around everything but grounds and walls: flat shapes that are much longer than all others."""
    boxes = _instance_boxes(draw_list.instances)
    boxes = boxes[~np.isnan(boxes[:, 0, 0])]
    sides = boxes[:, 1] - boxes[:, 0]
    longest_side = sides.max(axis=1)
    is_flat = sides.min(axis=1) < _FLAT_RATIO * longest_side
    solid_box = union(boxes[~is_flat])
    if solid_box is None:
        return union(boxes)
    ground_length = _GROUND_RATIO * float(np.linalg.norm(solid_box[1] - solid_box[0]))
    is_ground = is_flat & (longest_side > ground_length)
    return union(boxes[~is_ground])
