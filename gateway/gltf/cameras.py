"""Cameras of a glTF document, placed by the nodes that refer to them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from gateway.gltf import schema
from gateway.gltf.errors import as_warning, checked_item
from gateway.gltf.nodes import SceneNodes
from gateway.scene.transforms import Matrix

_SCALE_TOLERANCE: Final = 1e-12
"""Maximum deviation of an axis' length from 1 that is rounding and not scale."""


@dataclass(frozen=True, slots=True, eq=False)
class GltfCamera:
    """A camera, with the pose of the node that refers to it."""

    index: int
    """Index in the document's ``cameras``."""
    name: str
    """Name of the camera; the name of its node if the camera has none."""
    X_world_camera: Matrix
    """(4, 4) float64: pose of the optical frame (+Z forward, +X right, +Y down) in the document's world frame."""
    yfov: float | None
    """Vertical field of view, radians; None for an orthographic camera."""
    znear: float
    """Distance of the near plane, metres; 0 if it is absent."""
    zfar: float | None
    """Distance of the far plane, metres; None for an infinite projection."""
    xmag: float | None = None
    """Half of the width of an orthographic camera's view, metres; None for a perspective camera."""


def read_cameras(sources: list[schema.Camera | None], nodes: SceneNodes, warnings: list[str]) -> tuple[GltfCamera, ...]:
    """Return the camera of each node that has one, parents first. A reference to no camera gives a warning.

    Args:
        sources: The document's ``cameras``.
    """
    cameras = []
    for index, node, X_world_node in zip(nodes.indices, nodes.sources, nodes.X_world_node, strict=True):
        if node.camera is None:
            continue
        with as_warning(warnings, "the node has no camera"):
            source = checked_item(sources, node.camera, "cameras", f"nodes[{index}].camera")
            perspective = source.perspective or schema.Projection()
            orthographic = (None if source.perspective else source.orthographic) or schema.Projection()
            camera = GltfCamera(
                index=node.camera,
                name=source.name or node.name or "",
                X_world_camera=_optical_pose(X_world_node),
                yfov=perspective.yfov,
                xmag=orthographic.xmag,
                znear=perspective.znear or orthographic.znear or 0.0,
                zfar=perspective.zfar if source.perspective else orthographic.zfar,
            )
            cameras.append(camera)
    return tuple(cameras)


def _optical_pose(X_world_node: Matrix) -> Matrix:
    """Return the pose of the optical frame of a camera whose node has the pose ``X_world_node``.

    A glTF camera looks along -Z with +Y up. The scale of its node does not affect it (glTF 2.0, 3.10.2).
    """
    pose = X_world_node.copy()
    lengths = [math.sqrt(x * x + y * y + z * z) for x, y, z in pose[:3, :3].T.tolist()]
    scaled = any(abs(length - 1.0) > _SCALE_TOLERANCE for length in lengths)
    if scaled and all(0.0 < length < math.inf for length in lengths):
        pose[:3, :3] /= lengths
    pose[:3, 1:3] = 0.0 - pose[:3, 1:3]  # negation would make negative zeros
    return pose
