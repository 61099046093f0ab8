"""The two sets of topics and messages of recordings: Foxglove's schemas, and ROS 2's messages.

``foxglove`` needs mcap-protobuf-support and foxglove-schemas-protobuf, ``ros2`` needs mcap-ros2-support.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache
from importlib.resources import files
from typing import Any, Final, Literal, Protocol, get_args

import msgspec
from google.protobuf.message import Message

from scenegate.recording.mcap_file import EncodedMessage, Schema
from scenegate.recording.values import CameraSet, Cloud, ImuSample, JointValues, SceneChange

ProfileName = Literal["foxglove", "ros2"]
PROFILES: Final[tuple[ProfileName, ...]] = get_args(ProfileName)
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
_IMU_SCHEMA: Final = {
    "type": "object",
    "properties": {
        "timestamp": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
        **{
            name: {"type": "object", "properties": {axis: {"type": "number"} for axis in "xyz"}}
            for name in ("linear_acceleration", "angular_velocity")
        },
    },
}

Messages = Iterator[EncodedMessage]


class Profile(Protocol):
    """Converts values to messages as they are written."""

    name: str
    """Profile in the header of the files."""

    def scene(self, change: SceneChange) -> Messages:
        """Yield the messages of a change of the scene."""

    def camera(self, images: CameraSet) -> Messages:
        """Yield the messages of a camera's images."""

    def imu(self, sample: ImuSample) -> Messages:
        """Yield the message of a sample of the IMU."""

    def joints(self, joints: JointValues) -> Messages:
        """Yield the message of joint values."""


def make_profile(name: ProfileName) -> Profile:
    """Return a profile.

    Raises:
        ImportError: its packages are not installed.
    """
    return FoxgloveProfile() if name == "foxglove" else Ros2Profile()


class FoxgloveProfile:
    """Foxglove's schemas as protobuf; IMU samples, which have no schema there, as JSON."""

    name = ""

    def __init__(self) -> None:
        from scenegate.recording import foxglove_messages

        self._messages = foxglove_messages
        self._clouds = _CloudTopics()

    def schemas(self) -> dict[str, Schema]:
        """Return the schemas of the topics of scene and camera, without those of the scene's point clouds."""
        types = self._messages.TYPES
        image, calibration = _protobuf_schema(types["RawImage"]), _protobuf_schema(types["CameraCalibration"])
        return {
            TF_TOPIC: _protobuf_schema(types["FrameTransforms"]),
            SCENE_TOPIC: _protobuf_schema(types["SceneUpdate"]),
            **{image_topic: image for image_topic, _ in IMAGE_TOPICS.values()},
            **{info_topic: calibration for _, info_topic in IMAGE_TOPICS.values()},
            DISPARITY_TOPIC: image,
            CLOUD_TOPIC: self.cloud_schema(),
        }

    def cloud_schema(self) -> Schema:
        """Return the schema of the topics of point clouds."""
        return _protobuf_schema(self._messages.TYPES["PointCloud"])

    def cloud_topic(self, cloud: Cloud) -> str:
        """Return the topic of a cloud of the scene."""
        return self._clouds.topic(cloud)

    def scene(self, change: SceneChange) -> Messages:
        """See ``Profile``."""
        if change.transforms:
            yield _protobuf(TF_TOPIC, self._messages.frame_transforms(change.transforms, change.time))
        if change.entities:
            yield _protobuf(SCENE_TOPIC, self._messages.scene_update(change.entities, change.time))
        for cloud in change.clouds:
            yield _protobuf(self._clouds.topic(cloud), self._messages.point_cloud(cloud, change.time))

    def camera(self, images: CameraSet) -> Messages:
        """See ``Profile``."""
        for name, image in images.images.items():
            image_topic, info_topic = IMAGE_TOPICS[name]
            yield _protobuf(info_topic, self._messages.camera_calibration(image.calibration, images.time))
            yield _protobuf(image_topic, self._messages.raw_image(image, images.time))
        if images.disparity is not None:
            yield _protobuf(DISPARITY_TOPIC, self._messages.raw_image(images.disparity.image, images.time))
        if images.cloud is not None:
            yield _protobuf(CLOUD_TOPIC, self._messages.point_cloud(images.cloud, images.time))

    def imu(self, sample: ImuSample) -> Messages:
        """See ``Profile``."""
        message = {
            "timestamp": {"sec": sample.time // 10**9, "nsec": sample.time % 10**9},
            "linear_acceleration": dict(zip("xyz", sample.acceleration, strict=True)),
            "angular_velocity": dict(zip("xyz", sample.angular_velocity, strict=True)),
        }
        schema = Schema("scenegate.Imu", "jsonschema", msgspec.json.encode(_IMU_SCHEMA), "json")
        yield EncodedMessage(IMU_TOPIC, schema, msgspec.json.encode(message))

    def joints(self, joints: JointValues) -> Messages:
        """See ``Profile``."""
        yield _protobuf(JOINTS_TOPIC, self._messages.joint_states(joints))


class Ros2Profile:
    """ROS 2's messages in CDR, as rosbag2 writes them."""

    name = "ros2"

    def __init__(self) -> None:
        from scenegate.recording import ros2_messages

        self._messages = ros2_messages
        self._clouds = _CloudTopics()

    def scene(self, change: SceneChange) -> Messages:
        """See ``Profile``."""
        if change.transforms:
            yield _cdr(TF_TOPIC, self._messages.tf_message(change.transforms, change.time))
        if change.entities:
            yield _cdr(SCENE_TOPIC, self._messages.marker_array(change.entities, change.time))
        for cloud in change.clouds:
            yield _cdr(self._clouds.topic(cloud), self._messages.point_cloud2(cloud, change.time))

    def camera(self, images: CameraSet) -> Messages:
        """See ``Profile``."""
        for name, image in images.images.items():
            image_topic, info_topic = IMAGE_TOPICS[name]
            yield _cdr(info_topic, self._messages.camera_info(image.calibration, images.time))
            yield _cdr(image_topic, self._messages.image(image, images.time))
        if images.disparity is not None:
            yield _cdr(DISPARITY_TOPIC, self._messages.disparity_image(images.disparity, images.time))
        if images.cloud is not None:
            yield _cdr(CLOUD_TOPIC, self._messages.point_cloud2(images.cloud, images.time))

    def imu(self, sample: ImuSample) -> Messages:
        """See ``Profile``."""
        yield _cdr(IMU_TOPIC, self._messages.imu(sample))

    def joints(self, joints: JointValues) -> Messages:
        """See ``Profile``."""
        yield _cdr(JOINTS_TOPIC, self._messages.joint_state(joints))


class _CloudTopics:
    """Topics of the scene's point clouds: a path's characters that ROS 2 forbids in topics are underscores."""

    def __init__(self) -> None:
        self._topics: dict[str, str] = {}

    def topic(self, cloud: Cloud) -> str:
        """Return the topic of a cloud by its frame; each frame has a topic of its own."""
        topic = self._topics.get(cloud.frame)
        if topic is None:
            names = re.sub(r"[^A-Za-z0-9/]+", "_", cloud.frame).split("/")[1:]
            topic = "/".join((SCENE_CLOUDS_TOPIC, *(f"n{name}" if name[:1].isdigit() else name for name in names)))
            if topic in self._topics.values():
                topic += f"_{len(self._topics)}"
            self._topics[cloud.frame] = topic
        return topic


def _protobuf(topic: str, message: Message) -> EncodedMessage:
    message_type: Any = type(message)
    return EncodedMessage(topic, _protobuf_schema(message_type), message.SerializeToString())


@cache
def _protobuf_schema(message_type: Any) -> Schema:
    from mcap_protobuf.schema import build_file_descriptor_set

    descriptors = build_file_descriptor_set(message_type)
    return Schema(message_type.DESCRIPTOR.full_name, "protobuf", descriptors.SerializeToString(), "protobuf")


def _cdr(topic: str, message: Any) -> EncodedMessage:
    schema, encode = _ros2_type(message.type)
    return EncodedMessage(topic, schema, encode(message.fields))


@cache
def _ros2_type(name: str) -> tuple[Schema, Callable[[dict[str, Any]], bytes]]:
    """Return the schema and the encoder of a type, ``sensor_msgs/msg/Image``."""
    from mcap_ros2 import writer

    text = ros2_definition(name)
    # mcap_ros2.writer.Writer has the same encoders, but writes whole files, and does not flush them.
    encoders = writer.serialize_dynamic(name, text)
    return Schema(name, "ros2msg", text.encode(), "cdr"), encoders[name]


@cache
def ros2_definition(name: str) -> str:
    """Return the definition of a message type with those of the types of its fields, as MCAP's schemas have it."""
    definitions = _ros2_definitions()
    needed = [name.replace("/msg/", "/")]
    for each in needed:  # which grows
        for line in definitions[each].splitlines():
            field_type = re.sub(r"\[.*\]", "", line.split()[0])
            if "/" in field_type and field_type not in needed:
                needed.append(field_type)
    first, *others = needed
    separator = "=" * 80
    return definitions[first] + "".join(f"{separator}\nMSG: {each}\n{definitions[each]}" for each in others)


@cache
def _ros2_definitions() -> dict[str, str]:
    """Return the fields of each message type, one a line."""
    text = (files("scenegate.recording") / "ros2_definitions.txt").read_text("utf-8")
    sections = (section.split("\n", 1) for section in text.split("MSG: ")[1:])
    return {name.strip(): fields.strip() + "\n" for name, fields in sections}
