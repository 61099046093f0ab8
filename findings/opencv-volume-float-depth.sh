#!/usr/bin/env bash
# Package: opencv-python-headless 5.0.0.93 (cv::Volume).
# Wrong belief: depth in float32 is in metres, as in depthTo3d, registerDepth and rescaleDepth, which scale whole numbers only.
# Behaviour: Volume.integrate divides floats by the depth factor of its settings, too, by default 5000 (of the TUM data sets): it sees
#   a wall at 0.3 mm, and the volume stays empty. There is no error. Whole numbers of millimetres, which depthTo3d knows by their
#   type, are at 0.3 m, before the volume: empty as well.
# Why it matters: one gets an empty mesh from good depth, and looks for the mistake in poses and intrinsics. Set the factor to 1.
# Seen 2026-12-01: no points with the default, 4389 with setDepthFactor(1).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check opencv-python-headless==5.0.0.93 numpy==2.4.6
venv/bin/python - <<'PYTHON'
import cv2
import numpy as np

metres = np.full((480, 640), 1.5, np.float32)
millimetres = (1000 * metres).astype(np.uint16)
camera = np.array([[525, 0, 319.5], [0, 525, 239.5], [0, 0, 1]], np.float32)
assert np.allclose(cv2.depthTo3d(metres, camera)[..., 2], 1.5)
assert np.allclose(cv2.depthTo3d(millimetres, camera)[..., 2], 1.5)
assert np.allclose(cv2.rescaleDepth(metres, cv2.CV_32F, 5000.0), 1.5)


def points(depth, factor=None):
    settings = cv2.VolumeSettings(cv2.VolumeType_TSDF)
    if factor is not None:
        settings.setDepthFactor(factor)
    volume = cv2.Volume(cv2.VolumeType_TSDF, settings)
    volume.integrate(depth, np.eye(4, dtype=np.float32))
    found, _ = volume.fetchPointsNormals()
    return 0 if found is None else len(found)


seen = points(metres), points(millimetres), points(metres, 1.0), points(millimetres, 1000.0)
print(seen)
assert seen[:2] == (0, 0) and min(seen[2:]) > 1000
PYTHON
