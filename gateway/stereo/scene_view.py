"""Scene and pose of a stereo camera: the live tree or a fixed scene, seen from a mount."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gateway.scene.flatten import Flattener
from gateway.scene.live import Snapshot
from gateway.scene.mount import Mount
from gateway.stereo.config import StereoConfig
from renderers.camera import Camera
from renderers.drawlist import DrawList


class SceneView:
    """Scene and camera pose, both of the snapshot that ``scene`` took last."""

    def __init__(self, snapshot: Callable[[], Snapshot], flattener: Flattener, mount: Mount) -> None:
        """
        Args:
            snapshot: returns the current snapshot.
            flattener: makes the draw list of a snapshot.
            mount: pose of the camera in the scene.
        """
        self._take_snapshot = snapshot
        self._flattener = flattener
        self._mount = mount
        self._snapshot = snapshot()

    def scene(self) -> tuple[DrawList, int]:
        """Return the current scene and its revision."""
        self._snapshot = self._take_snapshot()
        return self._flattener.flatten(self._snapshot), self._snapshot.revision

    def pose(self) -> NDArray[np.float64]:
        """Return X_world_left, (4, 4) float64, in the snapshot of the last ``scene`` call."""
        return self.pose_in(self._snapshot)

    def pose_in(self, snapshot: Snapshot) -> NDArray[np.float64]:
        """Return X_world_left, (4, 4) float64, in a snapshot."""
        return self._mount.pose(snapshot.root)

    def warning(self) -> str:
        """Return a sentence if the camera's node is missing in the current snapshot, else an empty string."""
        self._mount.pose(self._take_snapshot().root)
        return self._mount.warning

    def camera(self, config: StereoConfig) -> Camera:
        """Return the left camera in the current snapshot."""
        k = config.model.intrinsics()
        pose = self.pose_in(self._take_snapshot())
        return Camera(k.width, k.height, k.focal_length, k.focal_length, k.cx, k.cy, config.near, config.far, pose)
