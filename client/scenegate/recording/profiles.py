"""The two formats of recordings: Foxglove's schemas, and ROS 2's messages. Both have the same topics."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Literal

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
from scenegate.recording.values import CameraSet, ImuSample, JointValues, SceneChange

ProfileName = Literal["foxglove", "ros2"]
Messages = Iterator[EncodedMessage]


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

    def scene(self, change: SceneChange) -> Messages:
        """Yield the messages of a change of the scene."""
        messages, time = self._messages, change.time
        if change.transforms:
            yield messages.encode(TF_TOPIC, messages.transforms(change.transforms, time))
        if change.entities:
            yield messages.encode(SCENE_TOPIC, messages.entities(change.entities, time))
        for cloud in change.clouds:
            topic = self.clouds.topic(cloud.frame)
            if topic is not None:
                yield messages.encode(topic, messages.cloud(cloud, time))

    def camera(self, images: CameraSet) -> Messages:
        """Yield the messages of a camera's images."""
        messages, time = self._messages, images.time
        for name, image in images.images.items():
            image_topic, info_topic = IMAGE_TOPICS[name]
            yield messages.encode(info_topic, messages.calibration(image.calibration, time))
            yield messages.encode(image_topic, messages.image(image, time))
        if images.disparity is not None:
            yield messages.encode(DISPARITY_TOPIC, messages.disparity(images.disparity, time))
        if images.cloud is not None:
            yield messages.encode(CLOUD_TOPIC, messages.cloud(images.cloud, time))

    def imu(self, sample: ImuSample) -> Messages:
        """Yield the message of a sample of the IMU."""
        yield self._messages.encode(IMU_TOPIC, self._messages.imu(sample))

    def joints(self, joints: JointValues) -> Messages:
        """Yield the message of joint values."""
        yield self._messages.encode(JOINTS_TOPIC, self._messages.joints(joints))
