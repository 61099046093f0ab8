"""Scene and pose of a stereo camera: the live tree or a fixed scene, seen from a mount."""

from __future__ import annotations

from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from gateway.scene.flatten import Flattener
from gateway.scene.live import KEPT_NANOSECONDS, LiveTree, Snapshot
from gateway.scene.mount import Mount
from gateway.stereo.device.camera_config import StereoConfig
from gateway.stereo.imaging.scene_motion import SceneState
from renderers.camera import Camera


class SceneView:
    """Scene and camera pose at any recent time."""

    def __init__(self, tree: LiveTree, flattener: Flattener, mount: Mount) -> None:
        """
        Args:
            tree: the scene.
            flattener: makes the draw list of a snapshot.
            mount: pose of the camera in the scene.
        """
        self.tree = tree
        self._flattener = flattener
        self._mount = mount

    def state(self, timestamp: int | None = None) -> SceneState:
        """Return scene and pose that were valid at a time, nanoseconds since the epoch; None: the current ones."""
        state = self.state_in(self.snapshot_at(timestamp), self._flattener)
        return state if timestamp is None else replace(state, timestamp=timestamp)

    def state_in(self, snapshot: Snapshot, flattener: Flattener) -> SceneState:
        """Return scene and pose in a snapshot."""
        scene, time = flattener.flatten(snapshot), snapshot.timestamp
        return SceneState(time, scene, self.pose_in(snapshot), snapshot.revision, time)

    def snapshot_at(self, timestamp: int | None) -> Snapshot:
        """Return the snapshot that was valid at a time as for ``state``."""
        return self.tree.snapshot if timestamp is None else self.tree.snapshot_at(timestamp)

    def pose_in(self, snapshot: Snapshot) -> NDArray[np.float64]:
        """Return X_world_left, (4, 4) float64, in a snapshot. An earlier one is not kept as the last."""
        is_earlier = snapshot.timestamp < self.tree.snapshot.timestamp - KEPT_NANOSECONDS
        return (copy(self._mount) if is_earlier else self._mount).pose(snapshot.root)

    def warning(self) -> str:
        """Return a sentence if the camera's node is missing in the current snapshot, else an empty string."""
        self._mount.pose(self.tree.snapshot.root)
        return self._mount.warning

    def camera(self, config: StereoConfig, snapshot: Snapshot) -> Camera:
        """Return the left camera in a snapshot."""
        k = config.model.intrinsics()
        pose = self.pose_in(snapshot)
        return Camera(k.width, k.height, k.focal_length, k.focal_length, k.cx, k.cy, config.near, config.far, pose)
