#!/usr/bin/env bash
# Package: opencv-python-headless 5.0.0.93, StereoSGBM.
# Wrong belief: its sixteenths of a pixel are at least as exact as those of StereoBM, since it is the better matcher.
# Behaviour: the penalties P1 and P2 for steps pull disparities to whole pixels, by up to 0.3 pixels with the recommended values
#   (8 and 32 times the window's pixels). Without penalties it is 0.1, with StereoBM less than 0.05. The other modes do the same.
# Why it matters: a slanted or curved surface becomes stairs. At f = 1000 pixels, 0.1 m baseline and 5 m, 0.3 pixels are 7.5 cm.
# Seen 2026-11-30: true 12.375 measured as 12.14, true 12.625 as 12.92; StereoBM 12.39 and 12.67.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check opencv-python-headless==5.0.0.93 numpy==2.4.6
venv/bin/python - <<'PYTHON'
import cv2
import numpy as np

WIDTH, HEIGHT, STEPS = 320, 160, 8  # the texture has eight columns a pixel: shifts by eighths are exact
noise = np.random.default_rng(1).integers(0, 256, (HEIGHT, (WIDTH + 64) * STEPS)).astype(np.float32)
noise = cv2.GaussianBlur(noise, (0, 0), sigmaX=STEPS, sigmaY=1)
texture = np.round((noise - noise.min()) / np.ptp(noise) * 255).astype(np.uint8)


def view(shift: float) -> np.ndarray:
    return np.ascontiguousarray(texture[:, int(shift * STEPS) :: STEPS][:, :WIDTH])


def measured(matcher: cv2.StereoMatcher, disparity: float) -> float:
    values = matcher.compute(view(32), view(32 + disparity))[20:-20, 80:-20]
    return round(float(values[values > 0].mean()) / 16, 2)


recommended = cv2.StereoSGBM_create(0, 48, 5, P1=8 * 5 * 5, P2=32 * 5 * 5)
without = cv2.StereoSGBM_create(0, 48, 5, P1=0, P2=0)
for disparity in (12.0, 12.375, 12.625):
    by = [measured(each, disparity) for each in (recommended, without, cv2.StereoBM_create(48, 15))]
    print("true", disparity, "SGBM", by[0], "without penalties", by[1], "BM", by[2])
    error = abs(by[0] - disparity)
    assert error < 0.02 if disparity == 12.0 else error > 0.2
    assert abs(by[1] - disparity) < 0.13
    assert abs(by[2] - disparity) < 0.06
PYTHON
