#!/usr/bin/env bash
# Package: opencv-python-headless 5.0.0.93 (cv2.Odometry).
# Wrong belief: 16-bit depth is in millimetres, as in depthTo3d and registerDepth of the same module, or the settings have its unit.
# Behaviour: Odometry divides it by 5000, the unit of the TUM data sets; OdometrySettings has no depth factor, unlike VolumeSettings.
#   Depth in float32 is in metres, as it should be. The motion of millimetres is a fifth of the true one, and compute returns True.
# Why it matters: rc_visard's, Kinect's and RealSense's recordings are millimetres. The path has the right form, and the wrong scale.
# Seen 2026-12-01: a camera that moves by 3, 2 and 4 cm has moved by 6, 4 and 8 mm; by 3, 2 and 4 cm from the same depth as float32.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check opencv-python-headless==5.0.0.93 numpy==2.4.6
venv/bin/python - <<'PYTHON'
import cv2
import numpy as np

CAMERA = np.array([[300, 0, 159.5], [0, 300, 119.5], [0, 0, 1]], np.float32)
u, v = np.meshgrid(np.arange(320), np.arange(240))
ray_x, ray_y = (u - 159.5) / 300, (v - 119.5) / 300


def depth_from(place):
    """Return the depth of a wavy wall 2 m away in metres, seen along z from a place."""
    depth = np.full(u.shape, 2.0)
    for _ in range(60):
        x, y = place[0] + depth * ray_x, place[1] + depth * ray_y
        wall = 2 + 0.25 * np.sin(2.1 * x) + 0.2 * np.cos(2.7 * y + 0.5 * x) + 0.05 * np.sin(7 * x) * np.cos(6 * y)
        depth += 0.5 * (wall - place[2] - depth)
    return depth.astype(np.float32)


def motion(first, second):
    settings = cv2.OdometrySettings()
    settings.setCameraMatrix(CAMERA)
    odometry = cv2.Odometry(cv2.OdometryType_DEPTH, settings, cv2.OdometryAlgoType_COMMON)
    grey = np.zeros((240, 320, 3), np.uint8)
    frames = cv2.OdometryFrame(first, grey), cv2.OdometryFrame(second, grey)
    odometry.prepareFrames(*frames)
    found, X = odometry.compute(*frames)
    assert found
    return -X[:3, 3]


place = np.array([0.03, -0.02, 0.04])
metres = depth_from((0, 0, 0)), depth_from(place)
millimetres = [(1000 * each).round().astype(np.uint16) for each in metres]
assert np.allclose(cv2.depthTo3d(millimetres[0], CAMERA)[..., 2], metres[0], atol=1e-3)
print("metres", motion(*metres).round(4), "millimetres", motion(*millimetres).round(4))
assert np.allclose(motion(*metres), place, atol=0.002)
assert np.allclose(motion(*millimetres), place / 5, atol=0.002)
PYTHON
