"""The two formats of recordings: Foxglove's schemas, and ROS 2's messages. Both have the same topics."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Literal

from scenegate.camera.imu import ImuSample
from scenegate.recording.mcap_file import EncodedMessage
from scenegate.recording.topics import (
    CLOUD_TOPIC,
    DISPARITY_TOPIC,
    IMAGE_TOPICS,
    IMU_TOPIC,
    JOINTS_TOPIC,
    SCENE_TOPIC,
    TF_TOPIC,
    CloudTopics,
)
from scenegate.recording.values import CameraSet, SceneChange

ProfileName = Literal["foxglove", "ros2"]
Messages = Iterator[EncodedMessage]
Wanted = Callable[[str], bool]
"""Returns True for the topics whose messages are made."""


def every_topic(topic: str) -> bool:
    """Return True, as the default of ``Wanted``."""
    return True


class Profile:
    """Converts values to encoded messages, with ``foxglove_messages`` or ``ros2_messages``."""

    def __init__(self, name: ProfileName, warn: Callable[[str], object] = lambda text: None) -> None:
        """
        Args:
            warn: called with a sentence about point clouds that are left out.

        Raises:
            ImportError: packages of the profile are not installed.
        """
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

    def camera(self, images: CameraSet, wanted: Wanted = every_topic) -> Messages:
        """Yield the messages of a camera's images."""
        messages = self._messages
        time_ns = images.time_ns
        for name, image in images.images.items():
            image_topic, info_topic = IMAGE_TOPICS[name]
            if wanted(info_topic):
                yield messages.encode(info_topic, messages.calibration(image.calibration, time_ns))
            if wanted(image_topic):
                yield messages.encode(image_topic, messages.image(image, time_ns))
        if images.disparity is not None and wanted(DISPARITY_TOPIC):
            yield messages.encode(DISPARITY_TOPIC, messages.disparity(images.disparity, time_ns))
        if images.cloud is not None and wanted(CLOUD_TOPIC):
            yield messages.encode(CLOUD_TOPIC, messages.cloud(images.cloud, time_ns))

    def imu(self, sample: ImuSample) -> Messages:
        """Yield the message of a sample of the IMU."""
        yield self._messages.encode(IMU_TOPIC, self._messages.imu(sample))
