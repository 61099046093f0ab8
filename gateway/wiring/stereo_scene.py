"""What the stereo camera sees and from where: the join of its room with the live tree or a scene file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gateway.assets.scene_file import read_scene_file
from gateway.scene.flatten import Flattener
from gateway.scene.labels import LabelTable
from gateway.scene.live import Snapshot
from gateway.scene.mount import Mount
from gateway.stereo.config import StereoConfig
from gateway.wiring.context import Context
from renderers.camera import Camera
from renderers.drawlist import DrawList


class StereoView:
    """The pose belongs to the snapshot whose scene was asked for last."""

    def __init__(self, context: Context, config: StereoConfig, mount: Mount) -> None:
        """
        Args:
            mount: where the camera is.
        """
        settings = context.settings
        self._context = context
        self._config = config
        self.mount = mount
        self._live = settings.stereo_scene == "live"
        self._flattener = context.flattener
        self._snapshot: Callable[[], Snapshot] = lambda: context.tree.snapshot
        if not self._live:
            fixed = Snapshot(read_scene_file(Path(settings.stereo_scene), up=settings.up).root, 0)
            self._flattener, self._snapshot = Flattener(LabelTable()), lambda: fixed
        self._seen = self._snapshot()

    def scene(self) -> tuple[DrawList, int]:
        """The scene as it is now, and its revision."""
        self._seen = self._snapshot()
        return self._flattener.flatten(self._seen), self._seen.revision

    def pose(self) -> NDArray[np.float64]:
        """(4, 4) float64: X_world_left in that scene."""
        return self.mount.pose(self._seen.root)

    def warning(self) -> str:
        """A sentence when the camera's node is missing now, be it that nobody has streamed yet; else empty."""
        self.mount.pose(self._snapshot().root)
        return self.mount.warning

    def camera(self) -> Camera | None:
        """The left camera in the live tree as it is now; None when it sees a file."""
        if not self._live:
            return None
        k = self._config.model.intrinsics()
        pose = self.mount.pose(self._context.tree.snapshot.root)
        near, far = self._config.near, self._config.far
        return Camera(k.width, k.height, k.focal_length, k.focal_length, k.cx, k.cy, near, far, pose)
