"""Convert values to Foxglove's messages. https://docs.foxglove.dev/docs/sdk/schemas

``ros2_messages`` has the same functions: ``topics.Profile`` calls one of both modules.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import cache
from importlib import import_module
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from mcap_protobuf.schema import build_file_descriptor_set
from numpy.typing import NDArray

from scenegate.recording import message_fields
from scenegate.recording.mcap_file import EncodedMessage, Schema
from scenegate.recording.message_fields import DISTORTION_MODEL, IDENTITY, Fields, Message, color, quaternion, vector
from scenegate.recording.topics import CLOUD_TOPIC, DISPARITY_TOPIC, IMAGE_TOPICS, SCENE_TOPIC, TF_TOPIC
from scenegate.recording.values import Calibration, CameraImage, Cloud, Disparity, Entity, FrameTransform, Primitive

_DELETE_ONE, _DELETE_ALL = 0, 1  # foxglove.SceneEntityDeletion.Type
_UINT8, _FLOAT32 = 1, 7  # foxglove.PackedElementField.NumericType
_LINE_LIST: Final = 2  # foxglove.LinePrimitive.Type
_LINE_STYLE: Final[Fields] = {"type": _LINE_LIST, "thickness": 1.0, "scale_invariant": True}
"""Separate lines, a pixel wide."""


def encode(topic: str, message: Message) -> EncodedMessage:
    """Return an encoded message."""
    schema, encode_fields = _schema_and_encoder(message.type)
    return EncodedMessage(topic, schema, encode_fields(message.fields))


def schemas() -> dict[str, Schema]:
    """Return the schemas of the topics of scene and camera. Clouds of the scene have that of ``CLOUD_TOPIC``."""
    types = {
        TF_TOPIC: "FrameTransforms",
        SCENE_TOPIC: "SceneUpdate",
        **{image_topic: "RawImage" for image_topic, _ in IMAGE_TOPICS.values()},
        **{info_topic: "CameraCalibration" for _, info_topic in IMAGE_TOPICS.values()},
        DISPARITY_TOPIC: "RawImage",
        CLOUD_TOPIC: "PointCloud",
    }
    return {topic: _schema_and_encoder(name)[0] for topic, name in types.items()}


@cache
def _schema_and_encoder(name: str) -> tuple[Schema, Callable[[Fields], bytes]]:
    """Return the schema and the encoder of a type, Foxglove's name without ``foxglove.``."""
    message_class: Any = getattr(import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)
    descriptors = build_file_descriptor_set(message_class).SerializeToString()
    schema = Schema(message_class.DESCRIPTOR.full_name, "protobuf", descriptors, "protobuf")
    return schema, lambda fields: bytes(message_class(**fields).SerializeToString())


def transforms(values: Iterable[FrameTransform], time_ns: int) -> Message:
    """Return ``foxglove.FrameTransforms`` with transforms that are valid from a time."""
    messages = [
        {
            "timestamp": _timestamp(time_ns),
            "parent_frame_id": each.parent,
            "child_frame_id": each.child,
            "translation": vector(each.translation),
            "rotation": quaternion(each.quaternion),
        }
        for each in values
    ]
    return Message("FrameTransforms", {"transforms": messages})


def entities(values: Iterable[Entity], time_ns: int) -> Message:
    """Return ``foxglove.SceneUpdate``, which replaces or deletes the geometry of nodes."""
    stamp = _timestamp(time_ns)
    added, deleted = [], []
    for entity in values:
        if not entity.primitives:
            deleted.append({"timestamp": stamp, "type": _DELETE_ONE, "id": entity.frame})
            continue
        triangles, lines = [], []
        for primitive in entity.primitives:
            if primitive.is_lines:
                lines.append(_primitive(LinePrimitive, primitive, _LINE_STYLE))
            else:
                triangles.append(_primitive(TriangleListPrimitive, primitive, {}))
        added.append(
            {
                "timestamp": stamp,
                "frame_id": entity.frame,
                "id": entity.frame,
                "frame_locked": True,
                "triangles": triangles,
                "lines": lines,
            }
        )
    return Message("SceneUpdate", {"entities": added, "deletions": deleted})


def _primitive(message_class: Any, value: Primitive, fields: Fields) -> Any:
    """Return the message of a primitive."""
    message = message_class(pose=IDENTITY, color=color(value.color), **fields)
    for name, rows in (("points", value.points), ("colors", value.colors)):
        if rows is not None:
            message.MergeFromString(_repeated(message.DESCRIPTOR.fields_by_name[name].number, rows))
    return message


def _repeated(number: int, rows: NDArray[Any]) -> bytes:
    """Return a repeated field in protobuf's wire format: messages whose fields 1, 2, … are these float64 numbers.

    Messages made one by one of dicts take six times as long, 0.5 s for 300,000 points.
    """
    columns = rows.shape[1]
    records = np.zeros(len(rows), [("head", "u1", 2), ("fields", [("tag", "u1"), ("value", "<f8")], columns)])
    records["head"] = number << 3 | 2, 9 * columns  # wire type 2, and the length
    records["fields"]["tag"] = [field << 3 | 1 for field in range(1, columns + 1)]
    records["fields"]["value"] = rows
    return records.tobytes()


def deletion_of_all(time_ns: int) -> Message:
    """Return ``foxglove.SceneUpdate`` that deletes the geometry of all nodes; only the live server sends it."""
    return Message("SceneUpdate", {"deletions": [{"timestamp": _timestamp(time_ns), "type": _DELETE_ALL}]})


def image(value: CameraImage, time_ns: int) -> Message:
    """Return ``foxglove.RawImage``."""
    return Message("RawImage", _header(value.calibration.frame, time_ns) | message_fields.image(value))


def calibration(value: Calibration, time_ns: int) -> Message:
    """Return ``foxglove.CameraCalibration`` of a rectified image."""
    fields = {
        "width": value.width,
        "height": value.height,
        "distortion_model": DISTORTION_MODEL,
        "D": (0.0,) * 5,
        "K": value.K,
        "R": np.eye(3).ravel(),
        "P": value.P,
    }
    return Message("CameraCalibration", _header(value.frame, time_ns) | fields)


def disparity(value: Disparity, time_ns: int) -> Message:
    """Return ``foxglove.RawImage`` of disparities, for which Foxglove has no schema."""
    return image(value.image, time_ns)


def cloud(value: Cloud, time_ns: int) -> Message:
    """Return ``foxglove.PointCloud``: x, y, z, and red, green, blue, alpha if it has colours."""
    columns = [{"name": name, "offset": 4 * index, "type": _FLOAT32} for index, name in enumerate("xyz")]
    if value.colors is not None:
        names = ("red", "green", "blue", "alpha")
        columns += [{"name": name, "offset": 12 + index, "type": _UINT8} for index, name in enumerate(names)]
    records = message_fields.packed_points(value, channels=(0, 1, 2), alpha=255)
    content = {"pose": IDENTITY, "point_stride": records.itemsize, "fields": columns, "data": records.tobytes()}
    return Message("PointCloud", _header(value.frame, time_ns) | content)


def joints(values: Mapping[str, float], time_ns: int) -> Message:
    """Return ``foxglove.JointStates``."""
    states = [{"name": name, "position": value} for name, value in values.items()]
    return Message("JointStates", {"timestamp": _timestamp(time_ns), "joints": states})


def _header(frame: str, time_ns: int) -> Fields:
    return {"timestamp": _timestamp(time_ns), "frame_id": frame}


def _timestamp(time_ns: int) -> Fields:
    return {"seconds": time_ns // 10**9, "nanos": time_ns % 10**9}
