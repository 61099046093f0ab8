"""Scene and pose of a stereo camera: the live tree or a fixed scene, seen from a mount."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from gateway.scene.cameras import CameraError, NodeCamera
from gateway.scene.flatten import Flattener
from gateway.scene.live import KEPT_NANOSECONDS, LiveTree, Snapshot
from gateway.scene.mount import Mount
from gateway.scene.tree import Node
from gateway.scene.viewpoints import resolve_camera
from gateway.stereo.device.camera_config import StereoConfig
from gateway.stereo.imaging.other_projector import OtherProjector
from gateway.stereo.imaging.scene_motion import SceneState
from renderers.camera import Camera
from renderers.drawlist import DrawList

ProjectorSource = Callable[[Snapshot], OtherProjector]
"""Returns a camera's projector in a snapshot of the scene."""


class SceneView:
    """Scene and camera pose at any recent time. While its node is missing, the camera keeps its last pose."""

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
            mount: place of the camera in the scene.
            projectors: projectors of all cameras that share theirs, by view; the owner adds them later.
        """
        self.tree = tree
        self._flattener = flattener
        self._mount = mount
        self._last_pose = mount.pose
        self._projectors = projectors

    def state(self, timestamp: int | None = None) -> SceneState:
        """Return scene and pose that were valid at a time, nanoseconds since the epoch; None: the current ones."""
        snapshot = self.tree.snapshot if timestamp is None else self.tree.snapshot_at(timestamp)
        return self.state_in(snapshot, self._flattener, timestamp)

    def state_in(self, snapshot: Snapshot, flattener: Flattener, timestamp: int | None = None) -> SceneState:
        """Return scene and pose in a snapshot, as the state at a time; None: at the time of the snapshot."""
        state_time = snapshot.timestamp if timestamp is None else timestamp
        scene = flattener.flatten(snapshot)
        # The images of a camera have the light of its own projector without these.
        others = tuple([projector_in(snapshot) for view, projector_in in self._projectors.items() if view is not self])
        return SceneState(
            state_time, scene, self.pose_in(snapshot), snapshot.revision, changed=snapshot.timestamp, projectors=others
        )

    def pose_in(self, snapshot: Snapshot) -> NDArray[np.float64]:
        """Return X_world_left, (4, 4) float64, in a snapshot."""
        try:
            pose = self._node_pose(snapshot.root)
        except CameraError:
            return self._last_pose
        is_recent = snapshot.timestamp >= self.tree.snapshot.timestamp - KEPT_NANOSECONDS
        if is_recent:  # a scene of the history does not move the camera
            self._last_pose = pose
        return pose

    def warning(self) -> str:
        """Return a sentence if the camera's node is missing in the current snapshot, else an empty string."""
        try:
            self._node_pose(self.tree.snapshot.root)
        except CameraError as error:
            return f"the stereo camera keeps its last pose: {error}"
        return ""

    def _node_pose(self, root: Node) -> NDArray[np.float64]:
        """Return the pose of the camera's node in the world, (4, 4) float64; that of a fixed mount if there is none.

        Raises:
            CameraError: the node is missing.
        """
        if self._mount.path is None:
            return self._mount.pose
        # Size and draw list have no effect on the pose.
        return resolve_camera(NodeCamera(self._mount.path), root, 1, 1, draw_list=DrawList()).X_world_camera

    def camera(self, config: StereoConfig, snapshot: Snapshot) -> Camera:
        """Return the left camera in a snapshot."""
        return config.model.camera(self.pose_in(snapshot), offset=0.0, divisor=1, near=config.near, far=config.far)
