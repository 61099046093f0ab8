"""Camera mounts: a fixed pose in the world, or a node of the tree."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gateway.scene.cameras import CameraError, LookAtCamera, NodeCamera, parse_camera
from gateway.scene.transforms import from_pose, look_at
from gateway.scene.tree import Node, Path
from gateway.scene.viewpoints import resolve_camera
from renderers.drawlist import DrawList


def parse_mount_pose(text: str) -> NDArray[np.float64]:
    """Parse the pose of an optical frame: ``x,y,z,qw,qx,qy,qz`` or ``eye=x,y,z;target=x,y,z;up=x,y,z``.

    Returns:
        (4, 4) float64.

    Raises:
        CameraError: The text is neither.
    """
    if "=" in text:
        look_at_camera = parse_camera(text)
        assert isinstance(look_at_camera, LookAtCamera)  # the only kind with an equals sign
        return look_at(look_at_camera.eye, look_at_camera.target, look_at_camera.up)
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 7 or not np.isfinite(numbers).all() or not any(numbers[3:]):
        raise CameraError(f"pose {text!r} is neither x,y,z,qw,qx,qy,qz nor eye=x,y,z;target=x,y,z;up=x,y,z")
    return from_pose(numbers[:3], numbers[3:])


def parse_mount_path(text: str) -> Path:
    """Parse a path of the tree from its JSON, ``["robot", "head"]``.

    Raises:
        CameraError: The text is not a list of names.
    """
    camera = parse_camera(f"path:{text}")
    assert isinstance(camera, NodeCamera)
    return camera.path


class Mount:
    """The pose of a mounted camera. Where its node is missing, the last pose is kept."""

    def __init__(self, pose: NDArray[np.float64], path: Path | None = None) -> None:
        """
        Args:
            pose: (4, 4) float64 X_world_camera, until the node exists.
            path: Node whose frame is the camera's optical frame; None: the pose is fixed.
        """
        self._pose = pose
        self._path = path
        self.warning = ""
        """Why the pose does not follow the node; empty where it does."""

    def pose(self, root: Node) -> NDArray[np.float64]:
        """Return X_world_camera in this tree, (4, 4) float64."""
        if self._path is not None:
            try:
                camera = resolve_camera(NodeCamera(self._path), root, 1, 1, draw_list=DrawList())
            except CameraError as error:
                self.warning = f"the stereo camera keeps its last pose: {error}"
            else:
                self._pose, self.warning = camera.X_world_camera, ""
        return self._pose
