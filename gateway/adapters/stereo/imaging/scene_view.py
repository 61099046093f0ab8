"""Scene, pose and outputs of a stereo camera at one time: the live tree or a fixed scene, seen from a mount."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.stream_settings import StreamSettings
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.cameras import CameraError, NodeCamera
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.mount import Mount
from gateway.scene.draw.viewpoints import resolve_camera
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.nodes import Node
from renderers.camera import Camera
from renderers.drawlist import DrawList
from renderers.stereo.model import StereoModel

VELOCITY_TIME: Final = 40_000_000
"""Time over which velocities are measured, nanoseconds, if the last frame is not as recent."""
SLOWEST_MOTION: Final = 100_000_000
"""Time without changes after which the scene was at rest, nanoseconds."""
MAX_SETTLING: Final = 30_000_000
"""Maximum age of a frame that waits for messages that arrived before it and are still being read, nanoseconds."""
_POLL_SECONDS: Final = 0.002


@dataclass(frozen=True, slots=True, eq=False)
class OtherProjector:
    """Projector half-way between the cameras of another stereo camera, which shares it (``--stereo-projectors``)."""

    X_world_left: NDArray[np.float64]
    """(4, 4) float64, pose of that camera's left optical frame."""
    model: StereoModel
    dot_light: float
    """Light that a full dot adds, relative to the rendered light."""
    settings: StreamSettings
    """Parameters of that camera, which switch the projector."""

    def camera(self, divisor: int, *, near: float, far: float) -> Camera:
        """Return the camera at the projector, with that camera's intrinsics at 1/``divisor`` of the resolution."""
        return self.model.camera(self.X_world_left, offset=self.model.baseline / 2, divisor=divisor, near=near, far=far)


@dataclass(frozen=True, slots=True, eq=False)
class SceneState:
    """Scene and camera pose at one time."""

    timestamp: int
    """Nanoseconds since the epoch."""
    scene: DrawList
    X_world_left: NDArray[np.float64]
    """(4, 4) float64, pose of the left optical frame."""
    revision: int = 0
    """Revision of the scene."""
    changed: int = 0
    """Time of the last change, nanoseconds since the epoch."""
    projectors: tuple[OtherProjector, ...] = ()
    """Projectors of other cameras."""
    mount: Mount | None = None
    """Place of the camera; another object after it was placed elsewhere."""


SceneSource = Callable[[int | None], SceneState]
"""Returns scene and pose that were valid at a time, nanoseconds since the epoch; None: the current ones. Called in
worker threads."""
ProjectorSource = Callable[[Snapshot], OtherProjector]
"""Returns a camera's projector in a snapshot of the scene."""


@dataclass(frozen=True, eq=False)
class Capture:
    """Scene, camera pose and digital outputs at one instant."""

    timestamp: int
    """Nanoseconds since the epoch."""
    scene: DrawList
    revision: int
    """Revision of the scene."""
    X_world_left: NDArray[np.float64]
    """(4, 4) float64, pose of the left optical frame in the world."""
    gpio: int
    """Values of the digital inputs and outputs, one bit each; Out1 is bit 0."""
    frame_number: int = 0
    earlier: SceneState | None = None
    """Frame before this one, for motion blur and rolling shutters; None: there is none, or nothing needs it."""
    projectors: tuple[OtherProjector, ...] = ()
    """Projectors of other cameras that are on."""

    @classmethod
    def of_state(
        cls,
        state: SceneState,
        settings: StreamSettings,
        timestamp: int,
        frame_number: int,
        earlier: SceneState | None = None,
        *,
        depth: bool,
    ) -> Capture:
        """Return a capture of a state, exposed for depth or for camera images. Clients get ``timestamp``, in
        nanoseconds.

        All cameras expose at the same time and for the same purpose, as with a common trigger: so their parameters tell
        which projectors are on.
        """
        gpio = settings.depth_gpio if depth else settings.camera_gpio
        projectors = tuple(
            each for each in state.projectors if (each.settings.depth_gpio if depth else each.settings.camera_gpio) & 1
        )
        return cls(timestamp, state.scene, state.revision, state.X_world_left, gpio, frame_number, earlier, projectors)

    @cached_property
    def out1_high(self) -> bool:
        """True if Out1 is high."""
        return bool(self.gpio & 1)

    def has_projection(self, config: StereoConfig) -> bool:
        """Return True if there is a projector and it is on. It is connected to Out1."""
        return config.projector and config.dot_light > 0.0 and self.out1_high


class SceneView:
    """Scene and camera pose at any recent time. While its node is missing, the camera keeps its last pose."""

    def __init__(
        self,
        tree: LiveTree,
        flattener: Flattener,
        mount: Mount,
        projectors: Mapping[SceneView, ProjectorSource] = MappingProxyType({}),
    ) -> None:
        """``projectors``: those of all cameras that share theirs, by view; the owner adds them later."""
        self.tree = tree
        self._flattener = flattener
        self._mount = mount
        self._last_pose = mount.pose
        self._last_revision = 0
        """Revision of the newest snapshot with the camera's node; ``_last_pose`` is the pose in it."""
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
            state_time,
            scene,
            self.pose_in(snapshot),
            snapshot.revision,
            changed=snapshot.timestamp,
            projectors=others,
            mount=self._mount,
        )

    def place(self, X_world_left: NDArray[np.float64]) -> None:
        """Move the camera to a pose, (4, 4) float64. Raises CameraError if it follows a node."""
        if self._mount.path is not None:
            raise CameraError(f"the camera follows the node {json.dumps(self._mount.path)}, which a program moves")
        self._mount, self._last_pose = Mount(X_world_left), X_world_left

    def pose_in(self, snapshot: Snapshot) -> NDArray[np.float64]:
        """Return X_world_left, (4, 4) float64, in a snapshot."""
        try:
            pose = self._node_pose(snapshot.root)
        except CameraError:
            return self._last_pose
        if snapshot.revision >= self._last_revision:  # a scene of the history does not move the camera
            self._last_pose, self._last_revision = pose, snapshot.revision
        return pose

    def warnings(self) -> list[str]:
        """Return a sentence if the camera's node is missing in the current snapshot, and one if lights are left out."""
        sentences = [sentence] if (sentence := self._flattener.warning()) else []
        try:
            self._node_pose(self.tree.snapshot.root)
        except CameraError as error:
            sentences.append(f"the stereo camera keeps its last pose: {error}")
        return sentences

    def _node_pose(self, root: Node) -> NDArray[np.float64]:
        """Return the pose of the camera's node, or of a fixed mount, in the world, (4, 4) float64. Raises CameraError
        without node."""
        if self._mount.path is None:
            return self._mount.pose
        # Size and draw list have no effect on the pose.
        return resolve_camera(NodeCamera(self._mount.path), root, 1, 1, draw_list=DrawList()).X_world_camera

    def camera(self, config: StereoConfig, snapshot: Snapshot) -> Camera:
        """Return the left camera in a snapshot."""
        return config.model.camera(self.pose_in(snapshot), offset=0.0, divisor=1, near=config.near, far=config.far)


class SceneReader:
    """Reads the scene for frames in worker threads."""

    def __init__(
        self,
        source: SceneSource,
        workers: WorkerPool,
        config: StereoConfig,
        has_unapplied_before: Callable[[int], bool] = lambda timestamp: False,
    ) -> None:
        """``has_unapplied_before`` is that of ``LiveTree``."""
        self._last: SceneState | None = None
        """Scene of the newest capture, for motion blur and rolling shutters."""
        self._source = source
        self._workers = workers
        self._config = config
        self._has_unapplied_before = has_unapplied_before

    async def capture(
        self, timestamp: int, sent_timestamp: int, settings: StreamSettings, frame_number: int, *, depth: bool
    ) -> Capture:
        """Return the capture of a frame; see ``read`` for errors, ``Capture.of_state`` for ``depth``.

        ``timestamp`` is the true time, ``sent_timestamp`` the one that clients get, which a fault may falsify,
        nanoseconds.
        """
        self._last, earlier = await self.read(timestamp)
        if earlier is not None:
            earlier = replace(earlier, timestamp=earlier.timestamp + sent_timestamp - timestamp)
        return Capture.of_state(self._last, settings, sent_timestamp, frame_number, earlier, depth=depth)

    async def read(self, timestamp: int) -> tuple[SceneState, SceneState | None]:
        """Return the scene at a time, and an earlier one if images depend on motion. Raises QueueFull.

        The time is in nanoseconds since the epoch; if it is simulated, the scene is the current one.
        """
        while (  # noqa: ASYNC110 - at most 30 ms
            self._has_unapplied_before(timestamp) and time.time_ns() - timestamp < MAX_SETTLING
        ):
            await asyncio.sleep(_POLL_SECONDS)
        return await self._workers.run(self._read, timestamp)

    def _read(self, timestamp: int) -> tuple[SceneState, SceneState | None]:
        if not self._config.uses_motion:
            return self._source(None if self._config.simulated_clock else timestamp), None
        if self._config.simulated_clock:
            return replace(self._source(None), timestamp=timestamp), self._last
        state = self._source(timestamp)
        return state, state_before(state, self._last, self._source)


def state_before(now: SceneState, last: SceneState | None, scene: Callable[[int], SceneState]) -> SceneState:
    """Return an earlier state, for velocities. The time between both is that between the messages that they are from.

    ``last`` is the state of the last frame, used if it is recent and the camera was not placed elsewhere since.
    ``scene`` returns the state at a time, nanoseconds since the epoch.
    """
    if last is None or last.mount is not now.mount or not 0 < now.timestamp - last.timestamp < 2 * VELOCITY_TIME:
        last = scene(now.timestamp - VELOCITY_TIME)
    # After a rest, the motion began at the earlier state, and not at the change before the rest.
    was_at_rest = last.timestamp - last.changed >= SLOWEST_MOTION
    begin = last.timestamp if was_at_rest else last.changed
    return replace(last, timestamp=now.timestamp - (now.changed - begin))
