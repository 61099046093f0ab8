#!/usr/bin/env bash
# Package: rerun-sdk 0.41.0, its importer of MCAP files.
# Wrong belief: the encoding of an image says what it is: mono8 is a camera's image, 32FC1 depth in metres, in the
#   messages of ROS 2 as in Foxglove's.
# Behaviour: of ROS 2, all images with one channel are depth images, mono8 and mono16, too; of Foxglove's RawImage none is,
#   not even 16UC1 and 32FC1.
# Why it matters: grey cameras are drawn into the 3D view as a surface of the distance "grey value", millimetres; depth of
#   Foxglove's recordings is not drawn there, and gets no colours of distances. Nothing is said of it.
# Seen 2026-11-30: ROS 2: mono8 16UC1 32FC1 are DepthImage, rgb8 is Image; Foxglove: all are Image.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check \
  rerun-sdk==0.41.0 mcap-ros2-support==0.6.0 mcap-protobuf-support==0.6.0 foxglove-schemas-protobuf==0.4.0

venv/bin/python - <<'PYTHON'
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from mcap_protobuf.writer import Writer as FoxgloveWriter
from mcap_ros2.writer import Writer as RosWriter

SEPARATOR = "=" * 80
DEFINITION = f"""std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
{SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec"""
TIME = 1_000_000_000
BYTES = {"mono8": 1, "16UC1": 2, "32FC1": 4, "rgb8": 3}
images = [
    {"height": 3, "width": 4, "encoding": encoding, "step": 4 * size, "data": bytes(12 * size)}
    for encoding, size in BYTES.items()
]
with open("ros2.mcap", "wb") as file:
    writer = RosWriter(file)
    schema = writer.register_msgdef("sensor_msgs/msg/Image", DEFINITION)
    for image in images:
        header = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "camera"}
        message = {"header": header, "is_bigendian": 0, **image}
        writer.write_message(f"/{image['encoding']}", schema, message, log_time=TIME, publish_time=TIME)
    writer.finish()
with open("foxglove.mcap", "wb") as file, FoxgloveWriter(file) as writer:
    for image in images:
        message = RawImage(frame_id="camera", **image)
        writer.write_message(f"/{image['encoding']}", message, log_time=TIME, publish_time=TIME)
PYTHON
for name in ros2 foxglove; do
  venv/bin/rerun mcap convert "$name.mcap" -o "$name.rrd" >log.txt 2>&1 || { cat log.txt; exit 1; }
  venv/bin/rerun rrd print "$name.rrd" | sed -nE 's|.* - (/[A-Za-z0-9]+) - .* (\w+):buffer .*|\1 \2|p' | sort | tee "$name.txt"
done
diff ros2.txt - <<'LINES'
/16UC1 DepthImage
/32FC1 DepthImage
/mono8 DepthImage
/rgb8 Image
LINES
diff foxglove.txt - <<'LINES'
/16UC1 Image
/32FC1 Image
/mono8 Image
/rgb8 Image
LINES
