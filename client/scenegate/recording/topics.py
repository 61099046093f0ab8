"""Topics of recordings, of Foxglove's server and of the ROS 2 node."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from itertools import count
from typing import Final

IMAGE_TOPICS: Final = {
    "left": ("/stereo/left/image_rect", "/stereo/left/camera_info"),
    "right": ("/stereo/right/image_rect", "/stereo/right/camera_info"),
    "depth": ("/stereo/depth/image_rect", "/stereo/depth/camera_info"),
}
"""Topics of each image and of its intrinsics. The disparity image has the intrinsics of ``depth``."""
DISPARITY_TOPIC: Final = "/stereo/disparity"
CLOUD_TOPIC: Final = "/stereo/points2"
IMU_TOPIC: Final = "/stereo/imu"
TF_TOPIC: Final = "/tf"
SCENE_TOPIC: Final = "/scene"
SCENE_CLOUDS_TOPIC: Final = "/scene/points"
"""Prefix of the topics of the scene's point clouds."""
JOINTS_TOPIC: Final = "/joint_states"
MAX_TOPIC_CHARACTERS: Final = 150
"""Maximum length of the topic of a cloud of the scene, without a number: ROS 2 refuses 256 with the namespace."""
MAX_SCENE_CLOUDS: Final = 1000
"""Maximum number of topics of the scene's point clouds: MCAP files and ROS 2 nodes keep each topic until they end."""


class CloudTopics:
    """Topics of the scene's point clouds. Thread-safe."""

    def __init__(self, warn: Callable[[str], object] = lambda text: None) -> None:
        """
        Args:
            warn: called with the first sentence of ``warnings``.
        """
        self._lock = threading.Lock()
        self._topics: dict[str, str] = {}
        """Topics by frame. ``_lock`` guards it."""
        self.warnings: tuple[str, ...] = ()
        """Sentence about the clouds that have no topic."""
        self._warn = warn

    def topic(self, frame: str) -> str | None:
        """Return the topic of the cloud of a frame; None beyond ``MAX_SCENE_CLOUDS``.

        It is the node's path, with an underscore instead of what ROS 2 forbids in topics, and a number if two frames
        would have the same topic.
        """
        with self._lock:
            if frame not in self._topics:
                if len(self._topics) >= MAX_SCENE_CLOUDS:
                    limit = f"the limit is {MAX_SCENE_CLOUDS} topics"
                    if not self.warnings:
                        self.warnings = (f"point clouds are left out, that of {frame} first: {limit}",)
                        self._warn(self.warnings[0])
                    return None
                self._topics[frame] = self._free_topic(frame)
            return self._topics[frame]

    def release(self, frame: str) -> str | None:
        """Free the topic of a cloud that was removed, and return it; None if it has none."""
        with self._lock:
            return self._topics.pop(frame, None)

    def _free_topic(self, frame: str) -> str:
        names = re.sub(r"[^A-Za-z0-9/]+", "_", frame).split("/")[1:]
        topic = "/".join((SCENE_CLOUDS_TOPIC, *(name if name[:1].isalpha() else f"n{name}" for name in names)))
        topic = topic[:MAX_TOPIC_CHARACTERS].rstrip("/")
        numbered = (topic if number == 1 else f"{topic.rstrip('_')}_{number}" for number in count(1))
        used = set(self._topics.values())
        return next(each for each in numbered if each not in used)
