"""Convert values to ROS 2 messages: a type's name and a dict of its fields, nested as the message is.

``encode`` encodes them as CDR with mcap-ros2-support, as rosbag2 writes them.
"""

import re
import struct
from collections.abc import Callable, Iterable, Mapping
from functools import cache
from importlib.resources import files
from typing import Final

import numpy as np
from mcap_ros2.writer import serialize_dynamic
from numpy.typing import NDArray

from scenegate.recording import message_fields
from scenegate.recording.mcap_file import EncodedMessage, Schema
from scenegate.recording.message_fields import DISTORTION_MODEL, IDENTITY, Fields, Message, quaternion, vector
from scenegate.recording.values import Calibration, CameraImage, Cloud, Disparity, Entity, FrameTransform, Primitive

LINE_METRES: Final = 0.003
"""Width of lines: markers have it in metres."""
_ADD, _DELETE = 0, 2
_LINE_LIST, _TRIANGLE_LIST = 5, 11
_FLOAT32: Final = 7
_MARKERS: Final = "visualization_msgs/msg/MarkerArray"
_HEAD, _SHIFTED_HEAD, _TAIL = (f"visualization_msgs/msg/Marker{part}" for part in ("Head", "ShiftedHead", "Tail"))
"""The fields of a marker before its points, those behind 4 bytes, and the fields behind its colours."""
_CDR_HEADER: Final = b"\x00\x01\x00\x00"
"""Little-endian. Fields are aligned from its end on."""


def encode(topic: str, message: Message) -> EncodedMessage:
    """Return an encoded message."""
    schema, encode_fields = _schema_and_encoder(message.type)
    if message.type == _MARKERS:
        encode_fields = _encode_markers
    return EncodedMessage(topic, schema, encode_fields(message.fields))


def transforms(values: Iterable[FrameTransform], time_ns: int) -> Message:
    """Return ``tf2_msgs/TFMessage`` with transforms that are valid from a time."""
    messages = [
        {
            "header": header(each.parent, time_ns),
            "child_frame_id": each.child,
            "transform": {"translation": vector(each.translation), "rotation": quaternion(each.quaternion)},
        }
        for each in values
    ]
    return Message("tf2_msgs/msg/TFMessage", {"transforms": messages})


def entities(values: Iterable[Entity], time_ns: int) -> Message:
    """Return ``visualization_msgs/MarkerArray``: new or deleted geometry. A frame is a namespace of markers."""
    markers: list[Fields] = []
    for entity in values:
        markers += [_marker(entity.frame, index, each, time_ns) for index, each in enumerate(entity.primitives)]
        markers += [
            {"header": header(entity.frame, time_ns), "ns": entity.frame, "id": index, "action": _DELETE}
            for index in range(len(entity.primitives), entity.earlier_primitive_count)
        ]
    return Message(_MARKERS, {"markers": markers})


def image(value: CameraImage, time_ns: int) -> Message:
    """Return ``sensor_msgs/Image``."""
    return Message("sensor_msgs/msg/Image", _image_fields(value, time_ns))


def calibration(value: Calibration, time_ns: int) -> Message:
    """Return ``sensor_msgs/CameraInfo`` of a rectified image."""
    fields = {
        "header": header(value.frame, time_ns),
        "height": value.height,
        "width": value.width,
        "distortion_model": DISTORTION_MODEL,
        "d": [0.0] * 5,
        "k": value.K,
        "r": np.eye(3).ravel().tolist(),
        "p": value.P,
    }
    return Message("sensor_msgs/msg/CameraInfo", fields)


def disparity(value: Disparity, time_ns: int) -> Message:
    """Return ``stereo_msgs/DisparityImage``. Invalid disparities are below ``min_disparity``."""
    intrinsics = value.image.calibration
    fields = {
        "header": header(intrinsics.frame, time_ns),
        "image": _image_fields(value.image, time_ns),
        "f": intrinsics.focal_length,
        "t": value.baseline,
        "valid_window": {"width": intrinsics.width, "height": intrinsics.height},
        "min_disparity": 0.0,
        "max_disparity": value.max_disparity,
        "delta_d": value.disparity_step,
    }
    return Message("stereo_msgs/msg/DisparityImage", fields)


def cloud(value: Cloud, time_ns: int) -> Message:
    """Return ``sensor_msgs/PointCloud2``: x, y, z, and rgb if it has colours."""
    columns = [
        {"name": name, "offset": 4 * index, "datatype": _FLOAT32, "count": 1} for index, name in enumerate("xyz")
    ]
    if value.colors is not None:
        columns.append({"name": "rgb", "offset": 12, "datatype": _FLOAT32, "count": 1})
    # The colour is a float32 of the bits of 0x00RRGGBB, as PCL has it.
    records = message_fields.packed_points(value, channels=(2, 1, 0), alpha=0)
    message = {
        "header": header(value.frame, time_ns),
        "height": 1,
        "width": len(records),
        "fields": columns,
        "is_bigendian": False,
        "point_step": records.itemsize,
        "row_step": records.nbytes,
        "data": records.tobytes(),
        "is_dense": True,
    }
    return Message("sensor_msgs/msg/PointCloud2", message)


def joints(values: Mapping[str, float], time_ns: int) -> Message:
    """Return ``sensor_msgs/JointState``."""
    fields = {
        "header": header("", time_ns),
        "name": list(values),
        "position": list(values.values()),
        "velocity": [],
        "effort": [],
    }
    return Message("sensor_msgs/msg/JointState", fields)


def header(frame: str, time_ns: int) -> Fields:
    """Return ``std_msgs/Header``."""
    return {"stamp": {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9}, "frame_id": frame}


def _image_fields(value: CameraImage, time_ns: int) -> Fields:
    return {"header": header(value.calibration.frame, time_ns), "is_bigendian": 0, **message_fields.image(value)}


def _marker(frame: str, index: int, primitive: Primitive, time_ns: int) -> Fields:
    size = LINE_METRES if primitive.is_lines else 1.0
    return {
        "header": header(frame, time_ns),
        "ns": frame,
        "id": index,
        "type": _LINE_LIST if primitive.is_lines else _TRIANGLE_LIST,
        "action": _ADD,
        "pose": IDENTITY,
        "scale": vector((size, size, size)),
        "color": message_fields.color(primitive.color),
        "frame_locked": True,
        "points": primitive.points,
        "colors": primitive.colors,
    }


def _encode_markers(fields: Fields) -> bytes:
    """Return ``visualization_msgs/MarkerArray`` as CDR, with arrays as ``points`` and ``colors``.

    The library encodes what has no array. It takes 4 µs for a point, 1.2 s for 300,000.
    """
    data = bytearray(_CDR_HEADER + struct.pack("<I", len(fields["markers"])))

    def align(size: int) -> None:
        data.extend(bytes((len(_CDR_HEADER) - len(data)) % size))

    def extend(rows: NDArray[np.float32] | None, numbers: str, size: int) -> None:
        count = 0 if rows is None else len(rows)
        data.extend(struct.pack("<I", count))
        if rows is not None and count:
            align(size)
            data.extend(rows.astype(numbers).tobytes())

    for marker in fields["markers"]:
        align(4)
        shift = (len(data) - len(_CDR_HEADER)) % 8  # 0 or 4; float64 is aligned to 8
        head = _schema_and_encoder(_SHIFTED_HEAD if shift else _HEAD)[1](marker)
        data += head[len(_CDR_HEADER) + shift :]
        align(4)
        extend(marker.get("points"), "<f8", 8)
        extend(marker.get("colors"), "<f4", 4)
        data += _schema_and_encoder(_TAIL)[1]({})[len(_CDR_HEADER) :]
    return bytes(data)


@cache
def _schema_and_encoder(name: str) -> tuple[Schema, Callable[[Fields], bytes]]:
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
    definitions = {name.strip(): fields.strip() + "\n" for name, fields in sections}
    head, _, rest = definitions["visualization_msgs/Marker"].partition("geometry_msgs/Point[] points\n")
    parts = {_HEAD: head, _SHIFTED_HEAD: f"uint32 shift\n{head}", _TAIL: rest.split("\n", 1)[1]}
    return definitions | {name.replace("/msg/", "/"): fields for name, fields in parts.items()}
