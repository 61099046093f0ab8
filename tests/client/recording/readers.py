"""Independent readers of MCAP files: descriptors in the file for Foxglove's schemas, rosbags for ROS 2."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from numpy.typing import NDArray

mcap_reader = pytest.importorskip("mcap.reader", reason="needs the extra mcap")
stream_reader = pytest.importorskip("mcap.stream_reader", reason="needs the extra mcap")
mcap_records = pytest.importorskip("mcap.records", reason="needs the extra mcap")
mcap_exceptions = pytest.importorskip("mcap.exceptions", reason="needs the extra mcap")
rosbags_highlevel = pytest.importorskip("rosbags.highlevel", reason="needs the package rosbags")
rosbags_typesys = pytest.importorskip("rosbags.typesys", reason="needs the package rosbags")


@dataclass
class Message:
    """A message that was read."""

    topic: str
    type: str
    log_time: int
    value: Any


def foxglove_messages(path: Path) -> Iterator[Message]:
    """Yield the protobuf messages of a file, decoded with the descriptors that the file has."""
    classes: dict[str, Any] = {}
    with path.open("rb") as file:
        for schema, channel, message in mcap_reader.make_reader(file).iter_messages():
            if channel.message_encoding != "protobuf":
                continue
            if schema.name not in classes:
                pool = descriptor_pool.DescriptorPool()
                for each in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
                    pool.Add(each)
                classes[schema.name] = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
            value = classes[schema.name].FromString(message.data)
            yield Message(channel.topic, schema.name, message.log_time, value)


def ros2_messages(path: Path) -> Iterator[Message]:
    """Yield the messages of a file, decoded with rosbags' own definitions of ROS 2 Humble."""
    store = rosbags_typesys.get_typestore(rosbags_typesys.Stores.ROS2_HUMBLE)
    with rosbags_highlevel.AnyReader([path], default_typestore=store) as reader:
        for connection, log_time, data in reader.messages():
            value = store.deserialize_cdr(data, connection.msgtype)
            yield Message(connection.topic, connection.msgtype, log_time, value)


def scanned_messages(path: Path) -> int:
    """Return the number of messages in the complete chunks of a file that may have no end."""
    count = 0
    with path.open("rb") as file:
        try:
            for record in stream_reader.StreamReader(file).records:
                count += isinstance(record, mcap_records.Message)
        except mcap_exceptions.EndOfFile:
            pass
    return count


@dataclass
class ReadScene:
    """The scene after all messages of a file, as a viewer has it."""

    parents: dict[str, str] = field(default_factory=dict)
    poses: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    geometry: dict[str, list[tuple[NDArray[np.float64], list[float]]]] = field(default_factory=dict)
    """Points (N, 3) and colour of each list of triangles or lines, in the node's frame."""

    def world(self, frame: str) -> NDArray[np.float64]:
        """Return X_world_frame."""
        matrix = np.eye(4)
        while frame != "world":
            matrix = self.poses[frame] @ matrix
            frame = self.parents[frame]
        return matrix

    def world_points(self) -> dict[str, list[tuple[NDArray[np.float64], list[float]]]]:
        """Return ``geometry`` in the world."""
        return {
            frame: [
                (points @ self.world(frame)[:3, :3].T + self.world(frame)[:3, 3], color) for points, color in primitives
            ]
            for frame, primitives in self.geometry.items()
        }


def rotation(x: float, y: float, z: float, w: float) -> NDArray[np.float64]:
    """Return the matrix of a unit quaternion by Rodrigues' formula."""
    cross = np.array(((0, -z, y), (z, 0, -x), (-y, x, 0)))
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * cross @ cross)


def foxglove_scene(path: Path) -> ReadScene:
    """Return the scene of a file with Foxglove's schemas."""
    scene = ReadScene()
    for message in foxglove_messages(path):
        if message.type == "foxglove.FrameTransforms":
            for each in message.value.transforms:
                t, q = each.translation, each.rotation
                _set_pose(scene, each.parent_frame_id, each.child_frame_id, t, q)
        elif message.type == "foxglove.SceneUpdate":
            for deletion in message.value.deletions:
                del scene.geometry[deletion.id]
            for entity in message.value.entities:
                assert entity.frame_id == entity.id
                scene.geometry[entity.id] = [
                    (
                        np.array([(p.x, p.y, p.z) for p in primitive.points]).reshape(-1, 3),
                        [primitive.color.r, primitive.color.g, primitive.color.b, primitive.color.a],
                    )
                    for primitive in (*entity.triangles, *entity.lines)
                ]
    return scene


def ros2_scene(path: Path) -> ReadScene:
    """Return the scene of a file with ROS 2's messages."""
    scene = ReadScene()
    for message in ros2_messages(path):
        if message.topic == "/tf":
            for each in message.value.transforms:
                transform = each.transform
                _set_pose(scene, each.header.frame_id, each.child_frame_id, transform.translation, transform.rotation)
        elif message.topic == "/scene":
            for marker in message.value.markers:
                primitives = scene.geometry.setdefault(marker.ns, [])
                if marker.action == 2:
                    primitives.pop(marker.id if marker.id < len(primitives) else -1)
                    if not primitives:
                        del scene.geometry[marker.ns]
                    continue
                points = np.array([(p.x, p.y, p.z) for p in marker.points]).reshape(-1, 3)
                color = [marker.color.r, marker.color.g, marker.color.b, marker.color.a]
                assert marker.header.frame_id == marker.ns
                primitives[marker.id : marker.id + 1] = [(points, color)]
    return scene


def _set_pose(scene: ReadScene, parent: str, child: str, t: Any, q: Any) -> None:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation(q.x, q.y, q.z, q.w), (t.x, t.y, t.z)
    scene.parents[child], scene.poses[child] = parent, matrix
