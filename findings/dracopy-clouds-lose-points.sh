#!/usr/bin/env bash
# Package: DracoPy 2.2.0.
# Wrong belief: a point cloud that is encoded and decoded has as many points as before, each moved by less than a
#   quantization step, and in the same order.
# Behaviour: equal points become one point, and the order is another, unless preserve_order=True.
# Why it matters: arrays beside the cloud (labels, rows of a depth image, whose holes are all 0 0 0) do not fit it any
#   more.
# Seen 2026-11-29: x of five points 0 1 0 0.5 0.25; decoded 0.5 1 0 0.25; with preserve_order 0 1 0 0.5 0.25.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 DracoPy==2.2.0

venv/bin/python - <<'PYTHON'
import DracoPy
import numpy as np

points = np.array([(0, 0, 0), (1, 0, 0), (0, 0, 0), (0.5, 0, 0), (0.25, 0, 0)], np.float32)
default = np.asarray(DracoPy.decode(DracoPy.encode(points, quantization_bits=14)).points)
ordered = np.asarray(DracoPy.decode(DracoPy.encode(points, quantization_bits=14, preserve_order=True)).points)
print(points[:, 0], default[:, 0], ordered[:, 0])
assert len(default) == 4
assert np.abs(default[:, 0] - np.array([0, 1, 0.5, 0.25])).max() > 0.1
assert len(ordered) == 5
assert np.abs(ordered - points).max() < 1e-4
PYTHON
