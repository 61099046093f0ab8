#!/usr/bin/env bash
# Packages: opencv-python-headless 5.0.0.93 and 4.13.0.92, Pillow 13.0.0 from PyPI.
# Wrong belief: cv2.imread gives the numbers of a PFM file, as readers of the Middlebury stereo data sets and Pillow do;
#   the third line says by its sign how bytes are ordered.
# Behaviour: OpenCV divides all numbers by the amount of the third line. It is 1/255 in files of pfmLib, by an author of the
#   Middlebury data sets, unless told otherwise, and pfmLib does not divide by it when it reads.
# Why it matters: disparities are 255 times too large, and depth is 255 times too small, without a warning: benchmarks and
#   training data are wrong. Files that OpenCV wrote itself, with -1, are read as they are, so that tests do not show it.
# Seen 2026-11-30: a disparity of 61.5 under "-0.003922" is 15680.8 in both versions of OpenCV, 61.5 in Pillow.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for version in 5.0.0.93 4.13.0.92; do
  python3 -m venv "venv-$version"
  "venv-$version/bin/pip" install --quiet --disable-pip-version-check "opencv-python-headless==$version" pillow==13.0.0
  "venv-$version/bin/python" - <<'PYTHON'
import cv2
import numpy as np
from PIL import Image

disparity = np.array([[61.5, 12.25], [0.5, 200.0]], "<f4")
for scale in ("-0.003922", "-1"):
    with open("disparity.pfm", "wb") as file:
        file.write(f"Pf\n2 2\n{scale}\n".encode() + disparity[::-1].tobytes())
    by_opencv = cv2.imread("disparity.pfm", cv2.IMREAD_UNCHANGED)
    by_pillow = np.asarray(Image.open("disparity.pfm"))
    print(f"OpenCV {cv2.__version__}, scale {scale}: {by_opencv[0, 0]:.1f}, Pillow: {by_pillow[0, 0]:.1f}")
    assert np.array_equal(by_pillow, disparity)
    assert np.allclose(by_opencv, disparity / abs(float(scale)), rtol=1e-5)
PYTHON
done
