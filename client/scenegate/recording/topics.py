"""Topics of recordings, of Foxglove's server and of the ROS 2 node, and the messages on them in two formats.

The formats are Foxglove's schemas and ROS 2's messages; both have the same topics.
"""

import re
import threading
from collections.abc import Callable, Iterator
from importlib import import_module
from itertools import count
from typing import Final, Literal

from scenegate.recording.mcap_file import EncodedMessage
from scenegate.recording.values import ExposureImages, SceneChange

IMAGE_TOPICS: Final = {
    "left": ("/stereo/left/image_rect", "/stereo/left/camera_info"),
    "right": ("/stereo/right/image_rect", "/stereo/right/camera_info"),
    "depth": ("/stereo/depth/image_rect", "/stereo/depth/camera_info"),
}
"""Topics of each image and of its intrinsics. The disparity image has the intrinsics of ``depth``."""
DISPARITY_TOPIC: Final = "/stereo/disparity"
CLOUD_TOPIC: Final = "/stereo/points2"
TF_TOPIC: Final = "/tf"
SCENE_TOPIC: Final = "/scene"
SCENE_CLOUDS_TOPIC: Final = "/scene/points"
"""Prefix of the topics of the scene's point clouds."""
JOINTS_TOPIC: Final = "/joint_states"
MAX_TOPIC_CHARACTERS: Final = 150
"""Maximum length of the topic of a cloud of the scene, without a number: ROS 2 refuses 256 with the namespace."""
MAX_SCENE_CLOUDS: Final = 1000
"""Maximum number of topics of the scene's point clouds: MCAP files and ROS 2 nodes keep each topic until they end."""
ProfileName = Literal["foxglove", "ros2"]
Messages = Iterator[EncodedMessage]
Wanted = Callable[[str], bool]
"""Returns True for the topics whose messages are made."""


class CloudTopics:
    """Topics of the scene's point clouds. Thread-safe."""

    def __init__(self, warn: Callable[[str], object] = lambda text: None) -> None:
        """``warn`` is called with the first sentence of ``warnings``."""
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
            if frame not in self._topics and len(self._topics) < MAX_SCENE_CLOUDS:
                self._topics[frame] = self._free_topic(frame)
            elif frame not in self._topics and not self.warnings:
                limit = f"the limit is {MAX_SCENE_CLOUDS} topics"
                self.warnings = (f"point clouds are left out, that of {frame} first: {limit}",)
                self._warn(self.warnings[0])
            return self._topics.get(frame)

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


def every_topic(topic: str) -> bool:
    """Return True, as the default of ``Wanted``."""
    return True


class Profile:
    """Converts values to encoded messages, with ``foxglove_messages`` or ``ros2_messages``."""

    def __init__(self, name: ProfileName, warn: Callable[[str], object] = lambda text: None) -> None:
        """``warn`` gets a sentence about point clouds that are left out. Raises ImportError without the packages."""
        self.mcap_profile = "ros2" if name == "ros2" else ""
        """Profile in the header of MCAP files."""
        self.clouds = CloudTopics(warn)
        self._messages = import_module(f"scenegate.recording.{name}_messages")

    def scene(self, change: SceneChange, wanted: Wanted = every_topic) -> Messages:
        """Yield the messages of a change of the scene."""
        messages = self._messages
        time_ns = change.time_ns
        if change.transforms and wanted(TF_TOPIC):
            yield messages.encode(TF_TOPIC, messages.transforms(change.transforms, time_ns))
        if change.entities and wanted(SCENE_TOPIC):
            yield messages.encode(SCENE_TOPIC, messages.entities(change.entities, time_ns))
        for cloud in change.clouds:
            topic = self.clouds.topic(cloud.frame)
            if topic is not None and wanted(topic):
                yield messages.encode(topic, messages.cloud(cloud, time_ns))
        if change.joints and wanted(JOINTS_TOPIC):
            yield messages.encode(JOINTS_TOPIC, messages.joints(change.joints, time_ns))

    def camera(self, exposure: ExposureImages, wanted: Wanted = every_topic) -> Messages:
        """Yield the messages of a camera's images."""
        messages = self._messages
        time_ns = exposure.time_ns
        for name, image in exposure.images.items():
            image_topic, info_topic = IMAGE_TOPICS[name]
            if wanted(info_topic):
                yield messages.encode(info_topic, messages.calibration(image.calibration, time_ns))
            if wanted(image_topic):
                yield messages.encode(image_topic, messages.image(image, time_ns))
        if exposure.disparity is not None and wanted(DISPARITY_TOPIC):
            yield messages.encode(DISPARITY_TOPIC, messages.disparity(exposure.disparity, time_ns))
        if exposure.cloud is not None and wanted(CLOUD_TOPIC):
            yield messages.encode(CLOUD_TOPIC, messages.cloud(exposure.cloud, time_ns))
