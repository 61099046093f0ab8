#!/usr/bin/env bash
# Package: pybag-sdk 0.13.0.
# Wrong belief: it reads ROS 2 messages as ROS 2 writes them.
# Behaviour: before the numbers of a sequence of doubles it skips to a multiple of eight bytes, also if there are none; ROS 2, rosbags
#   0.11.9, mcap-ros2-support 0.6.0 and its own writer do so only if there are some. What follows is read from the wrong place.
# Why it matters: a JointState with positions and efforts, but no velocities, has no efforts, without an error; one of positions alone,
#   as joint_state_publisher's, raises struct.error.
# Seen 2026-11-30: efforts 5 and 6 are read as an empty array, also from a file that it wrote.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
  pybag-sdk==0.13.0 rosbags==0.11.9 mcap==1.6.0 mcap-ros2-support==0.6.0 numpy==2.4.6

cat >joints.py <<'PYTHON'
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from pybag.mcap_reader import McapFileReader
from pybag.mcap_writer import McapFileWriter
from pybag.ros2.humble import builtin_interfaces, sensor_msgs, std_msgs
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

TYPE = "sensor_msgs/msg/JointState"
store = get_typestore(Stores.ROS2_HUMBLE)
types = store.types
stamp = types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="base")


def state(position, velocity, effort):
    arrays = (np.array(values, np.float64) for values in (position, velocity, effort))
    return types[TYPE](header, ["a", "b"], *arrays)


with Writer("joints", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
    for topic, message in {"full": state([1, 2], [3, 4], [5, 6]), "still": state([1, 2], [], [5, 6])}.items():
        writer.write(writer.add_connection(topic, TYPE, typestore=store), 1, store.serialize_cdr(message, TYPE))
(path,) = Path("joints").glob("*.mcap")

with path.open("rb") as file:
    decoded = make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=["still"])
    assert [list(message.effort) for *_, message in decoded] == [[5, 6]]
reader = McapFileReader.from_file(path)
efforts = {topic: [list(each.data.effort) for each in reader.messages(topic)] for topic in ("full", "still")}
print("read:", efforts)
assert efforts == {"full": [[5, 6]], "still": [[]]}

own = sensor_msgs.JointState(
    header=std_msgs.Header(stamp=builtin_interfaces.Time(sec=1, nanosec=2), frame_id="base"),
    name=["a", "b"],
    position=[1.0, 2.0],
    velocity=[],
    effort=[5.0, 6.0],
)
with McapFileWriter.open("own.mcap") as writer:
    writer.add_channel("still", schema=type(own))
    writer.write_message("still", 1, own)
reader = McapFileReader.from_file("own.mcap")
read_back = [list(each.data.effort) for each in reader.messages("still")]
print("written and read:", read_back)
assert read_back == [[]]
PYTHON
venv/bin/python joints.py
