#!/usr/bin/env bash
# Package: rerun-sdk 0.41.0, its importer of MCAP files.
# Wrong belief: an image is projected by the CameraInfo beside it, /depth/camera_info for /depth/image.
# Behaviour: images and intrinsics find each other by their frame_id only. Where two sizes of images have one frame, as a
#   rectified image and the depth that was computed from it at half of its size, both have the intrinsics of either.
# Why it matters: the depth is drawn with the focal length and principal point of the other image: half as wide, beside
#   where it is, and unlike the PointCloud2 of the same camera. Stereo drivers, as that of the rc_visard, give all images one
#   frame.
# Seen 2026-11-30: both intrinsics belong to "camera_image_plane". In the viewer, a wall of depth 2 m, which the camera sees
#   2.4 m wide, is half as wide as its points if the file also has an image of twice the size, and as wide without.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check rerun-sdk==0.41.0 mcap-ros2-support==0.6.0

venv/bin/python - <<'PYTHON'
from mcap_ros2.writer import Writer

SEPARATOR = "=" * 80
HEADER = f"""{SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{SEPARATOR}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
IMAGE = f"""std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
{HEADER}"""
CAMERA_INFO = f"""std_msgs/Header header
uint32 height
uint32 width
string distortion_model
float64[] d
float64[9] k
float64[9] r
float64[12] p
uint32 binning_x
uint32 binning_y
sensor_msgs/RegionOfInterest roi
{HEADER}{SEPARATOR}
MSG: sensor_msgs/RegionOfInterest
uint32 x_offset
uint32 y_offset
uint32 height
uint32 width
bool do_rectify
"""
with open("sizes.mcap", "wb") as file:
    writer = Writer(file)
    image = writer.register_msgdef("sensor_msgs/msg/Image", IMAGE)
    info = writer.register_msgdef("sensor_msgs/msg/CameraInfo", CAMERA_INFO)
    for topic, scale, encoding, pixel_bytes in (("/depth", 1, "32FC1", 4), ("/left", 2, "rgb8", 3)):
        width, height, f = 64 * scale, 48 * scale, 54.0 * scale
        common = {
            "header": {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "camera"},
            "width": width,
            "height": height,
        }
        intrinsics = {
            "distortion_model": "plumb_bob",
            "d": [0.0] * 5,
            "k": [f, 0.0, width / 2, 0.0, f, height / 2, 0.0, 0.0, 1.0],
            "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
            "p": [f, 0.0, width / 2, 0.0, 0.0, f, height / 2, 0.0, 0.0, 0.0, 1.0, 0.0],
        }
        step = width * pixel_bytes
        pixels = {"encoding": encoding, "is_bigendian": 0, "step": step, "data": bytes(height * step)}
        time = {"log_time": 1_000_000_000, "publish_time": 1_000_000_000}
        writer.write_message(f"{topic}/camera_info", info, common | intrinsics, **time)
        writer.write_message(f"{topic}/image", image, common | pixels, **time)
    writer.finish()
PYTHON
venv/bin/rerun mcap convert sizes.mcap -o sizes.rrd >log.txt 2>&1 || { cat log.txt; exit 1; }
for topic in depth left; do
  venv/bin/rerun rrd print -vvv --entity "/$topic/camera_info" sizes.rrd >"$topic.txt"
  grep -oE '\[camera_image_plane\].*\[\[[0-9.]+, .*' "$topic.txt" | sed -E 's/ *┆ */  /g; s/ *│.*//'
done | tee planes.txt
grep -q 'camera_image_plane.*\[\[54.0, ' planes.txt
grep -q 'camera_image_plane.*\[\[108.0, ' planes.txt
