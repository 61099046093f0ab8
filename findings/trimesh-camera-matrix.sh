#!/usr/bin/env bash
# Package: trimesh 5.2.0 from PyPI.
# Wrong belief: camera.K = matrix gives a trimesh camera the focal lengths and the principal point of a calibration, for
#   images of its resolution.
# Behaviour: the principal point becomes the middle of the image: the resolution is set to twice the principal point, without
#   a warning. A resolution set afterwards moves the principal point back to the middle, and keeps the focal lengths.
# Why it matters: no real camera has its principal point in the middle. Rays, and what is computed of them, such as depth by
#   ray casting, belong to an image of another size, or are turned by the offset against the camera's own.
# Seen 2026-11-30: of a camera of 640 x 480, a matrix with the principal point (330, 250) makes one of 660 x 500; with the
#   resolution set again, its principal point is (320, 240).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check trimesh==5.2.0

venv/bin/python - <<'PYTHON'
import numpy as np
from trimesh.scene import Camera

calibrated = np.array(((500.0, 0.0, 330.0), (0.0, 500.0, 250.0), (0.0, 0.0, 1.0)))
camera = Camera(resolution=(640, 480), focal=(500.0, 500.0))
camera.K = calibrated
rays, pixels = camera.to_rays()
print("resolution:", camera.resolution, "rays:", len(rays))
assert camera.resolution.tolist() == [660, 500]
assert len(rays) == 660 * 500

camera.resolution = (640, 480)
print("with the resolution set again:", camera.K[:2].tolist())
assert camera.K[0, 0] == 500.0
assert camera.K[:2, 2].tolist() == [320.0, 240.0]
PYTHON
