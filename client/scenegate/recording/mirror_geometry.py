"""Read meshes and transforms from frames of the gateway's view, and make primitives and point clouds of recordings.

A ``view_frame`` is a binary WebSocket message of ``/view/ws``; a ``frame_id`` names a coordinate frame.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from scenegate.recording.values import Cloud, Color, Primitive
from scenegate.recording.view_frames import ViewFrame, ViewFrameError
from scenegate.transforms import from_pose, is_rotation, quaternions_of

POINTS: Final = 1
"""Topology of point clouds."""
LINES: Final = 2
"""Topology of lines; others are triangles."""
IDENTITY: Final = np.eye(3)


@dataclass(slots=True, eq=False)
class MirrorMesh:
    """Points, lines or triangles."""

    positions: NDArray[np.float32]
    """(N, 3)."""
    colors: NDArray[np.uint8] | None
    """(N, 4) sRGB and alpha."""
    indices: NDArray[np.uint32] | None
    topology: int


def read_mesh(view_frame: ViewFrame) -> MirrorMesh:
    """Return the mesh of a frame of the kind ``mesh``."""
    header = view_frame.header
    positions = view_frame.array(header["position"], "<f4").reshape(-1, 3)
    colors = view_frame.array(header["color"], np.uint8).reshape(len(positions), 4) if "color" in header else None
    indices = view_frame.array(header["index"], "<u4") if "index" in header else None
    if indices is not None and len(indices) and int(indices.max()) >= len(positions):
        raise ViewFrameError(f"a mesh of {len(positions)} points has the index {int(indices.max())}")
    return MirrorMesh(positions, colors, indices, header["topology"])


def read_transforms(view_frame: ViewFrame) -> Iterator[tuple[int, NDArray[np.float64], list[float] | None]]:
    """Yield (node id, X_parent_node, quaternion) of the nodes that moved.

    X_parent_node is (4, 4). The quaternion [w, x, y, z] is None if the node has a matrix instead of a pose.
    Transforms that are not finite are left out.
    """
    poses, matrices = view_frame.header.get("poses"), view_frame.header.get("matrices")
    if poses is not None:
        ids = view_frame.array(poses["ids"], "<u4").tolist()
        values = view_frame.array(poses["values"], "<f4").reshape(-1, 7)
        for node_id, pose in zip(ids, values.tolist(), strict=True):
            norm = math.hypot(*pose[3:])
            quaternion = [value / norm for value in pose[3:]] if norm > 0.0 else [1.0, 0.0, 0.0, 0.0]
            if math.isfinite(sum(pose)):
                yield node_id, from_pose(pose[:3], quaternion), quaternion
    if matrices is not None:
        ids = view_frame.array(matrices["ids"], "<u4").tolist()
        column_major = view_frame.array(matrices["values"], "<f8").reshape(-1, 4, 4)
        for node_id, matrix in zip(ids, column_major.transpose(0, 2, 1), strict=True):
            if np.isfinite(matrix).all():
                yield node_id, matrix, None


def split_rigid(
    parent_stretch: NDArray[np.float64], X: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the polar decomposition of ``parent_stretch @ X``: a rigid transform, (4, 4), and the stretch, (3, 3).

    The stretch is applied first; it is ``IDENTITY`` if the product is rigid.
    """
    matrix = X.copy()
    if parent_stretch is not IDENTITY:
        matrix[:3] = parent_stretch @ X[:3]
    linear = matrix[:3, :3]
    if is_rotation(linear, 1e-6):
        return matrix, IDENTITY
    U, _, Vt = np.linalg.svd(linear)
    rotation = U @ np.diag((1.0, 1.0, np.sign(np.linalg.det(U @ Vt)) or 1.0)) @ Vt
    stretch = rotation.T @ linear  # before linear, a view of matrix, is replaced
    matrix[:3, :3] = rotation
    return matrix, stretch


def quaternion_of(X: NDArray[np.float64]) -> list[float]:
    quaternion: list[float] = quaternions_of(X[None, :3, :3])[0].tolist()
    return quaternion


@dataclass(frozen=True, slots=True, eq=False)
class NodeGeometry:
    """Geometry of a node, in its coordinate frame."""

    primitives: tuple[Primitive, ...] = ()
    cloud: Cloud | None = None
    """All points of the node."""


NO_GEOMETRY: Final = NodeGeometry()


def node_geometry(
    frame_id: str,
    draws: Sequence[dict[str, Any]],
    meshes: Mapping[int, MirrorMesh],
    stretch: NDArray[np.float64],
    alpha: float,
) -> NodeGeometry:
    """Return the geometry of a node, without draws whose mesh is not received yet or whose matrix is not finite.

    ``frame_id``: its coordinate frame, to which ``stretch``, (3, 3), leads. ``draws``: JSON objects of the view with
    mesh id, matrix and material. ``alpha``: factor of the opacity.
    """
    primitives: list[Primitive] = []
    clouds: list[Cloud] = []
    for draw in draws:
        mesh = meshes.get(draw["mesh"])
        X_node_mesh = _draw_matrix(draw)
        if mesh is None or X_node_mesh is None or not len(mesh.positions):
            continue
        linear, offset = stretch @ X_node_mesh[:3, :3], stretch @ X_node_mesh[:3, 3]
        points = np.nan_to_num((mesh.positions @ linear.T + offset).astype(np.float32))
        red, green, blue, opacity = draw["material"]["color"]
        color: Color = (red, green, blue, min(max(opacity * alpha, 0.0), 1.0))
        if mesh.topology == POINTS:
            clouds.append(_cloud_of(frame_id, points, mesh, color))
            continue
        colors = None if mesh.colors is None else (mesh.colors * (np.asarray(color) / 255.0)).astype(np.float32)
        if mesh.indices is not None:
            points = points[mesh.indices]
            colors = None if colors is None else colors[mesh.indices]
        primitives.append(Primitive(points, color, colors, is_lines=mesh.topology == LINES))
    return NodeGeometry(tuple(primitives), _merge(clouds))


def _draw_matrix(draw: dict[str, Any]) -> NDArray[np.float64] | None:
    """Return X_node_mesh, (4, 4); None if the view sent null, for a matrix that is not finite."""
    if "matrix" not in draw:
        return np.eye(4)
    return None if draw["matrix"] is None else np.asarray(draw["matrix"], np.float64).reshape(4, 4).T


def _cloud_of(frame_id: str, points: NDArray[np.float32], mesh: MirrorMesh, color: Color) -> Cloud:
    rgb = np.asarray(color[:3]) * (255.0 if mesh.colors is None else mesh.colors[:, :3])
    colors = np.broadcast_to(np.asarray(rgb + 0.5, np.uint8), (len(points), 3))
    return Cloud(frame_id, points, colors)


def _merge(clouds: list[Cloud]) -> Cloud | None:
    """Return one cloud of the points of all; None if there are none."""
    if len(clouds) < 2:
        return clouds[0] if clouds else None
    colors = [cloud.colors for cloud in clouds if cloud.colors is not None]
    return Cloud(clouds[0].frame, np.concatenate([cloud.points for cloud in clouds]), np.concatenate(colors))
