"""Cameras of the scene's nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from gateway.gltf import schema
from gateway.gltf.errors import checked_item
from gateway.gltf.nodes import SceneNodes
from gateway.scene.transforms import Matrix

_SCALE_TOLERANCE: Final = 1e-12
"""Deviation of an axis' length from 1 that is rounding, not scale."""


@dataclass(frozen=True, slots=True, eq=False)
class GltfCamera:
    """A camera of a node."""

    index: int
    """Index in the document's ``cameras``."""
    name: str
    """Name of the camera, else of its node."""
    X_world_camera: Matrix
    """(4, 4) float64: pose of the optical frame (+Z forward, +X right, +Y down) in the document's world."""
    yfov: float | None
    """Vertical field of view, radians; None for an orthographic camera."""
    znear: float
    """Metres; 0 where it is absent."""
    zfar: float | None
    """Metres; None for an infinite projection."""
    aspect: float | None
    """Width / height; None for the aspect of the viewport."""


def read_cameras(sources: list[schema.Camera | None], nodes: SceneNodes) -> tuple[GltfCamera, ...]:
    """Return a camera for every node with one, parents first.

    Args:
        sources: The document's ``cameras``.

    Raises:
        GltfError: A node refers to a camera that does not exist.
    """
    cameras = []
    for position, node in enumerate(nodes.sources):
        if node.camera is None:
            continue
        source = checked_item(sources, node.camera, "cameras", f"nodes[{nodes.indices[position]}].camera")
        perspective = source.perspective
        lens = perspective or source.orthographic
        camera = GltfCamera(
            index=node.camera,
            name=source.name or node.name or "",
            X_world_camera=_optical_pose(nodes.X_world_node[position]),
            yfov=None if perspective is None else perspective.yfov,
            znear=0.0 if lens is None or lens.znear is None else lens.znear,
            zfar=None if lens is None else lens.zfar,
            aspect=None if perspective is None else perspective.aspect_ratio,
        )
        cameras.append(camera)
    return tuple(cameras)


def _optical_pose(X_world_node: Matrix) -> Matrix:
    """Return the pose of the optical frame of a camera's node, without scale, which cameras ignore (glTF 2.0, 3.10.2).

    A glTF camera looks along -Z with +Y up.
    """
    pose = X_world_node.copy()
    lengths = [math.sqrt(x * x + y * y + z * z) for x, y, z in pose[:3, :3].T.tolist()]
    scaled = any(abs(length - 1.0) > _SCALE_TOLERANCE for length in lengths)
    if scaled and all(0.0 < length < math.inf for length in lengths):
        pose[:3, :3] /= lengths
    pose[:3, 1:3] = 0.0 - pose[:3, 1:3]  # not -x: no negative zeros
    return pose
