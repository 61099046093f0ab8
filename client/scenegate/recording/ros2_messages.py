"""Convert values to ROS 2 messages: a type's name and a dict of its fields, nested as the message is.

``encode`` encodes them as CDR with mcap-ros2-support, as rosbag2 writes them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

import numpy as np
from mcap_ros2.writer import serialize_dynamic

from scenegate.recording.mcap_file import EncodedMessage, Schema
from scenegate.recording.values import (
    IMU_FRAME,
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

Fields = dict[str, Any]
Encoder = Callable[[Fields], bytes]
LINE_METRES = 0.003
"""Width of lines: markers have it in metres."""
_ADD, _DELETE = 0, 2
_LINE_LIST, _TRIANGLE_LIST = 5, 11
_UINT32, _FLOAT32 = 6, 7
_NO_ROTATION: Fields = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


class Ros2Message(NamedTuple):
    """A message."""

    type: str
    """Name of the type, ``sensor_msgs/msg/Image``."""
    fields: Fields


def encode(topic: str, message: Ros2Message) -> EncodedMessage:
    """Return an encoded message."""
    schema, encode_fields = _type(message.type)
    return EncodedMessage(topic, schema, encode_fields(message.fields))


def transforms(values: Iterable[FrameTransform], time: int) -> Ros2Message:
    """Return ``tf2_msgs/TFMessage`` with transforms that are valid from a time."""
    messages = [
        {
            "header": header(each.parent, time),
            "child_frame_id": each.child,
            "transform": {"translation": _vector(each.translation), "rotation": _quaternion(each.quaternion)},
        }
        for each in values
    ]
    return Ros2Message("tf2_msgs/msg/TFMessage", {"transforms": messages})


def entities(values: Iterable[Entity], time: int) -> Ros2Message:
    """Return ``visualization_msgs/MarkerArray``, which replaces or deletes the geometry of nodes.

    A node's frame is the namespace of its markers.
    """
    markers: list[Fields] = []
    for entity in values:
        markers += [_marker(entity.frame, index, each, time) for index, each in enumerate(entity.primitives)]
        markers += [
            {"header": header(entity.frame, time), "ns": entity.frame, "id": index, "action": _DELETE}
            for index in range(len(entity.primitives), entity.earlier_count)
        ]
    return Ros2Message("visualization_msgs/msg/MarkerArray", {"markers": markers})


def image(value: CameraImage, time: int) -> Ros2Message:
    """Return ``sensor_msgs/Image``."""
    return Ros2Message("sensor_msgs/msg/Image", _image_fields(value, time))


def calibration(value: Calibration, time: int) -> Ros2Message:
    """Return ``sensor_msgs/CameraInfo`` of a rectified image."""
    fields = {
        "header": header(value.frame, time),
        "height": value.height,
        "width": value.width,
        "distortion_model": "plumb_bob",
        "d": [0.0] * 5,
        "k": value.K,
        "r": np.eye(3).ravel().tolist(),
        "p": value.P,
    }
    return Ros2Message("sensor_msgs/msg/CameraInfo", fields)


def disparity(value: Disparity, time: int) -> Ros2Message:
    """Return ``stereo_msgs/DisparityImage``. Invalid disparities are below ``min_disparity``."""
    intrinsics = value.image.calibration
    fields = {
        "header": header(intrinsics.frame, time),
        "image": _image_fields(value.image, time),
        "f": intrinsics.focal_length,
        "t": value.baseline,
        "valid_window": {"width": intrinsics.width, "height": intrinsics.height},
        "min_disparity": 0.0,
        "max_disparity": value.max_disparity,
        "delta_d": value.delta_d,
    }
    return Ros2Message("stereo_msgs/msg/DisparityImage", fields)


def cloud(value: Cloud, time: int) -> Ros2Message:
    """Return ``sensor_msgs/PointCloud2``: x, y, z, and rgb if it has colours."""
    fields = [{"name": name, "offset": 4 * index, "datatype": _FLOAT32, "count": 1} for index, name in enumerate("xyz")]
    columns: list[tuple[str, str, tuple[int, ...]]] = [("points", "<f4", (3,))]
    if value.colors is not None:
        fields.append({"name": "rgb", "offset": 12, "datatype": _FLOAT32, "count": 1})
        columns.append(("bgr", "u1", (4,)))  # a float32 of the bits of 0x00RRGGBB, as PCL has it
    data = np.zeros(len(value.points), np.dtype(columns))
    data["points"] = value.points
    if value.colors is not None:
        data["bgr"][:, :3] = value.colors[:, ::-1]
    message = {
        "header": header(value.frame, time),
        "height": 1,
        "width": len(data),
        "fields": fields,
        "is_bigendian": False,
        "point_step": data.dtype.itemsize,
        "row_step": data.nbytes,
        "data": data.tobytes(),
        "is_dense": True,
    }
    return Ros2Message("sensor_msgs/msg/PointCloud2", message)


def imu(sample: ImuSample) -> Ros2Message:
    """Return ``sensor_msgs/Imu`` without an orientation (REP 145: its first covariance is -1)."""
    fields = {
        "header": header(IMU_FRAME, sample.time),
        "orientation": _NO_ROTATION,
        "orientation_covariance": [-1.0] + [0.0] * 8,
        "angular_velocity": _vector(sample.angular_velocity),
        "angular_velocity_covariance": [0.0] * 9,
        "linear_acceleration": _vector(sample.acceleration),
        "linear_acceleration_covariance": [0.0] * 9,
    }
    return Ros2Message("sensor_msgs/msg/Imu", fields)


def joints(values: JointValues) -> Ros2Message:
    """Return ``sensor_msgs/JointState``."""
    fields = {
        "header": header("", values.time),
        "name": list(values.values),
        "position": list(values.values.values()),
        "velocity": [],
        "effort": [],
    }
    return Ros2Message("sensor_msgs/msg/JointState", fields)


def header(frame: str, time: int) -> Fields:
    """Return ``std_msgs/Header``.

    Args:
        time: nanoseconds since the epoch.
    """
    return {"stamp": {"sec": time // 10**9, "nanosec": time % 10**9}, "frame_id": frame}


def _image_fields(value: CameraImage, time: int) -> Fields:
    return {
        "header": header(value.calibration.frame, time),
        "height": value.calibration.height,
        "width": value.calibration.width,
        "encoding": value.encoding,
        "is_bigendian": 0,
        "step": value.step,
        "data": value.data,
    }


def _marker(frame: str, index: int, primitive: Primitive, time: int) -> Fields:
    size = LINE_METRES if primitive.is_lines else 1.0
    return {
        "header": header(frame, time),
        "ns": frame,
        "id": index,
        "type": _LINE_LIST if primitive.is_lines else _TRIANGLE_LIST,
        "action": _ADD,
        "pose": {"position": {"x": 0.0, "y": 0.0, "z": 0.0}, "orientation": _NO_ROTATION},
        "scale": {"x": size, "y": size, "z": size},
        "color": _color(primitive.color),
        "frame_locked": True,
        "points": [{"x": x, "y": y, "z": z} for x, y, z in primitive.points.tolist()],
        "colors": [] if primitive.colors is None else [_color(row) for row in primitive.colors.tolist()],
    }


def _color(color: Sequence[float]) -> Fields:
    red, green, blue, alpha = color
    return {"r": red, "g": green, "b": blue, "a": alpha}


def _vector(numbers: Sequence[float]) -> Fields:
    x, y, z = numbers
    return {"x": x, "y": y, "z": z}


def _quaternion(quaternion: Sequence[float]) -> Fields:
    w, x, y, z = quaternion
    return {"x": x, "y": y, "z": z, "w": w}


@cache
def _type(name: str) -> tuple[Schema, Encoder]:
    """Return the schema and the encoder of a type, ``sensor_msgs/msg/Image``."""
    text = definition(name)
    # mcap_ros2.writer.Writer has the same encoders, but writes whole files, and does not flush them.
    encoders = serialize_dynamic(name, text)
    return Schema(name, "ros2msg", text.encode(), "cdr"), encoders[name]


@cache
def definition(name: str) -> str:
    """Return the definition of a message type with those of the types of its fields, as MCAP's schemas have it."""
    definitions = _definitions()
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
def _definitions() -> dict[str, str]:
    """Return the fields of each message type, one a line."""
    text = (files("scenegate.recording") / "ros2_definitions.txt").read_text("utf-8")
    sections = (section.split("\n", 1) for section in text.split("MSG: ")[1:])
    return {name.strip(): fields.strip() + "\n" for name, fields in sections}
