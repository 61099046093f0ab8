"""Scene and pose of a stereo camera: the live tree or a fixed scene, seen from a mount."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from gateway.scene.flatten import Flattener
from gateway.scene.live import KEPT_NANOSECONDS, LiveTree, Snapshot
from gateway.scene.mount import Mount
from gateway.stereo.device.camera_config import StereoConfig
from gateway.stereo.imaging.other_projector import OtherProjector
from gateway.stereo.imaging.scene_motion import SceneState
from renderers.camera import Camera

ProjectorSource = Callable[[Snapshot], OtherProjector]
"""Returns a camera's projector in a snapshot of the scene."""


class SceneView:
    """Scene and camera pose at any recent time."""

    def __init__(
        self,
        tree: LiveTree,
        flattener: Flattener,
        mount: Mount,
        projectors: Mapping[SceneView, ProjectorSource] = MappingProxyType({}),
    ) -> None:
        """
        Args:
            tree: the scene.
            flattener: makes the draw list of a snapshot.
            mount: pose of the camera in the scene.
            projectors: projectors that all cameras see, by their cameras' views.
        """
        self.tree = tree
        self._flattener = flattener
        self._mount = mount
        self._projectors = projectors

    def state(self, timestamp: int | None = None) -> SceneState:
        """Return scene and pose that were valid at a time, nanoseconds since the epoch; None: the current ones."""
        snapshot = self.tree.snapshot if timestamp is None else self.tree.snapshot_at(timestamp)
        return self.state_in(snapshot, self._flattener, timestamp)

    def state_in(self, snapshot: Snapshot, flattener: Flattener, timestamp: int | None = None) -> SceneState:
        """Return scene and pose in a snapshot, as the state at a time; None: that of the snapshot."""
        changed = snapshot.timestamp
        scene = flattener.flatten(snapshot)
        projectors = tuple([project(snapshot) for view, project in self._projectors.items() if view is not self])
        timestamp = changed if timestamp is None else timestamp
        return SceneState(timestamp, scene, self.pose_in(snapshot), snapshot.revision, changed, projectors)

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
