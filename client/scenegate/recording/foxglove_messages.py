"""Convert values to Foxglove's messages. https://docs.foxglove.dev/docs/sdk/schemas"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any

import msgspec
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform as FrameTransformMessage
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointState_pb2 import JointState
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.PackedElementField_pb2 import PackedElementField
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneEntityDeletion_pb2 import SceneEntityDeletion
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.message import Message
from google.protobuf.timestamp_pb2 import Timestamp
from mcap_protobuf.schema import build_file_descriptor_set

from scenegate.recording.mcap_file import EncodedMessage, Schema
from scenegate.recording.topics import CLOUD_TOPIC, DISPARITY_TOPIC, IMAGE_TOPICS, SCENE_TOPIC, TF_TOPIC
from scenegate.recording.values import (
    Calibration,
    CameraImage,
    Cloud,
    Disparity,
    Entity,
    FrameTransform,
    ImuSample,
    JointValues,
    Primitive,
)

_IMU_SCHEMA = {
    "type": "object",
    "properties": {
        "timestamp": {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}},
        **{
            name: {"type": "object", "properties": {axis: {"type": "number"} for axis in "xyz"}}
            for name in ("linear_acceleration", "angular_velocity")
        },
    },
}
LINE_PIXELS = 1.0
"""Width of lines."""


def encode(topic: str, message: Message | dict[str, Any]) -> EncodedMessage:
    """Return an encoded message: protobuf, or JSON for a dict."""
    if isinstance(message, dict):
        schema = Schema("scenegate.Imu", "jsonschema", msgspec.json.encode(_IMU_SCHEMA), "json")
        return EncodedMessage(topic, schema, msgspec.json.encode(message))
    message_type: Any = type(message)
    return EncodedMessage(topic, _schema(message_type), message.SerializeToString())


def schemas() -> dict[str, Schema]:
    """Return the schemas of the topics of scene and camera, without those of the scene's point clouds."""
    return {
        TF_TOPIC: _schema(FrameTransforms),
        SCENE_TOPIC: _schema(SceneUpdate),
        **{image_topic: _schema(RawImage) for image_topic, _ in IMAGE_TOPICS.values()},
        **{info_topic: _schema(CameraCalibration) for _, info_topic in IMAGE_TOPICS.values()},
        DISPARITY_TOPIC: _schema(RawImage),
        CLOUD_TOPIC: cloud_schema(),
    }


def cloud_schema() -> Schema:
    """Return the schema of the topics of point clouds."""
    return _schema(PointCloud)


@cache
def _schema(message_type: Any) -> Schema:
    descriptors = build_file_descriptor_set(message_type)
    return Schema(message_type.DESCRIPTOR.full_name, "protobuf", descriptors.SerializeToString(), "protobuf")


def transforms(values: Iterable[FrameTransform], time: int) -> FrameTransforms:
    """Return the message with transforms that are valid from a time."""
    stamp = _timestamp(time)
    messages = []
    for each in values:
        x, y, z = each.translation
        messages.append(
            FrameTransformMessage(
                timestamp=stamp,
                parent_frame_id=each.parent,
                child_frame_id=each.child,
                translation=Vector3(x=x, y=y, z=z),
                rotation=_quaternion(each.quaternion),
            )
        )
    return FrameTransforms(transforms=messages)


def entities(values: Iterable[Entity], time: int) -> SceneUpdate:
    """Return the message that replaces or deletes the geometry of nodes."""
    stamp = _timestamp(time)
    update = SceneUpdate()
    for entity in values:
        if not entity.primitives:
            update.deletions.append(
                SceneEntityDeletion(timestamp=stamp, type=SceneEntityDeletion.MATCHING_ID, id=entity.frame)
            )
            continue
        update.entities.append(
            SceneEntity(
                timestamp=stamp,
                frame_id=entity.frame,
                id=entity.frame,
                frame_locked=True,
                triangles=[_triangles(each) for each in entity.primitives if not each.is_lines],
                lines=[_lines(each) for each in entity.primitives if each.is_lines],
            )
        )
    return update


def deletion_of_all(topic: str, time: int) -> EncodedMessage:
    """Return the message that deletes the geometry of all nodes."""
    deletion = SceneEntityDeletion(timestamp=_timestamp(time), type=SceneEntityDeletion.ALL)
    return encode(topic, SceneUpdate(deletions=[deletion]))


def image(value: CameraImage, time: int) -> RawImage:
    """Return an image."""
    intrinsics = value.calibration
    return RawImage(
        timestamp=_timestamp(time),
        frame_id=intrinsics.frame,
        width=intrinsics.width,
        height=intrinsics.height,
        encoding=value.encoding,
        step=value.step,
        data=value.data,
    )


def calibration(value: Calibration, time: int) -> CameraCalibration:
    """Return the intrinsics of a rectified image."""
    return CameraCalibration(
        timestamp=_timestamp(time),
        frame_id=value.frame,
        width=value.width,
        height=value.height,
        distortion_model="plumb_bob",
        D=(0.0,) * 5,
        K=value.K,
        R=np.eye(3).ravel(),
        P=value.P,
    )


def disparity(value: Disparity, time: int) -> RawImage:
    """Return a disparity image, which has no schema of its own."""
    return image(value.image, time)


def cloud(value: Cloud, time: int) -> PointCloud:
    """Return a point cloud: x, y, z, and red, green, blue, alpha if it has colours."""
    number, byte = PackedElementField.FLOAT32, PackedElementField.UINT8
    fields = [PackedElementField(name=name, offset=4 * index, type=number) for index, name in enumerate("xyz")]
    columns: list[tuple[str, str, tuple[int, ...]]] = [("points", "<f4", (3,))]
    if value.colors is not None:
        names = ("red", "green", "blue", "alpha")
        fields += [PackedElementField(name=name, offset=12 + index, type=byte) for index, name in enumerate(names)]
        columns.append(("colors", "u1", (4,)))
    data = np.zeros(len(value.points), np.dtype(columns))
    data["points"] = value.points
    if value.colors is not None:
        data["colors"][:, :3] = value.colors
        data["colors"][:, 3] = 255
    return PointCloud(
        timestamp=_timestamp(time),
        frame_id=value.frame,
        pose=_identity_pose(),
        point_stride=data.dtype.itemsize,
        fields=fields,
        data=data.tobytes(),
    )


def imu(sample: ImuSample) -> dict[str, Any]:
    """Return a sample of an IMU, which has no schema there: it is encoded as JSON."""
    return {
        "timestamp": {"sec": sample.time // 10**9, "nsec": sample.time % 10**9},
        "linear_acceleration": dict(zip("xyz", sample.acceleration, strict=True)),
        "angular_velocity": dict(zip("xyz", sample.angular_velocity, strict=True)),
    }


def joints(values: JointValues) -> JointStates:
    """Return the values of joints."""
    states = [JointState(name=name, position=value) for name, value in values.values.items()]
    return JointStates(timestamp=_timestamp(values.time), joints=states)


def _triangles(primitive: Primitive) -> TriangleListPrimitive:
    return TriangleListPrimitive(
        pose=_identity_pose(), points=_points(primitive), color=_color(primitive.color), colors=_colors(primitive)
    )


def _lines(primitive: Primitive) -> LinePrimitive:
    return LinePrimitive(
        type=LinePrimitive.LINE_LIST,
        pose=_identity_pose(),
        thickness=LINE_PIXELS,
        scale_invariant=True,
        points=_points(primitive),
        color=_color(primitive.color),
        colors=_colors(primitive),
    )


def _points(primitive: Primitive) -> list[Point3]:
    return [Point3(x=x, y=y, z=z) for x, y, z in primitive.points.tolist()]


def _colors(primitive: Primitive) -> list[Color]:
    return [] if primitive.colors is None else [_color(row) for row in primitive.colors.tolist()]


def _color(color: Sequence[float]) -> Color:
    red, green, blue, alpha = color
    return Color(r=red, g=green, b=blue, a=alpha)


def _quaternion(quaternion: Sequence[float]) -> Quaternion:
    w, x, y, z = quaternion
    return Quaternion(w=w, x=x, y=y, z=z)


def _identity_pose() -> Pose:
    return Pose(position=Vector3(), orientation=Quaternion(w=1.0))


def _timestamp(time: int) -> Timestamp:
    return Timestamp(seconds=time // 10**9, nanos=time % 10**9)
