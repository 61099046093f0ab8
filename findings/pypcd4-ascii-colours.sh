#!/usr/bin/env bash
# Package: pypcd4 1.5.1.
# Wrong belief: the three encodings of PCD files hold the same cloud, ASCII with some digits less.
# Behaviour: ASCII files get ten digits after the point of each float. Colours are packed into the bits of a float, which is about
#   1e-38: each is written as 0.0000000000, black.
# Why it matters: a cloud of ROS or PCL saved as text, to look at it or for a program that reads no binary files, has lost its colours,
#   while its points are right. PCL writes them with an exponent, or as whole numbers.
# Seen 2026-12-01: (200, 100, 50) comes back from both binary encodings, as (0, 0, 0) from ASCII; 1e-11 comes back as 0, too.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pypcd4==1.5.1 numpy==2.4.6 pydantic==2.14.4 pydantic_core==2.50.5 \
  annotated-types==0.8.0 python-neo-lzf==0.3.5 typing-inspection==0.4.5 typing_extensions==4.16.0
venv/bin/python - <<'PYTHON'
import numpy as np
from pypcd4 import Encoding, PointCloud

points = np.array([[1.0, 2.0, 1e-11], [0.0, 0.0, 1.0]], np.float32)
rgb = PointCloud.encode_rgb(np.array([[200, 100, 50]] * 2, np.uint8))
cloud = PointCloud.from_xyzrgb_points(np.column_stack([points, rgb]))
seen = {}
for encoding in (Encoding.BINARY, Encoding.BINARY_COMPRESSED, Encoding.ASCII):
    cloud.save("cloud.pcd", encoding=encoding)
    read = PointCloud.from_path("cloud.pcd")
    colour = PointCloud.decode_rgb(np.ascontiguousarray(read.pc_data["rgb"]))
    seen[encoding.name] = colour[0].tolist(), float(read.pc_data["z"][0]) > 0
print(seen)
assert seen["BINARY"] == seen["BINARY_COMPRESSED"] == ([200, 100, 50], True)
assert seen["ASCII"] == ([0, 0, 0], False)
PYTHON
