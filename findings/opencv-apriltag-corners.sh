#!/usr/bin/env bash
# Packages: opencv-python-headless 5.0.0.93 and 4.13.0.92 from PyPI.
# Wrong belief: cornerRefinementMethod of cv2.aruco's detector says how exact corners are; whatever it is, they are positions
#   in OpenCV's coordinates, in which (0, 0) is the middle of the first pixel, as camera matrices and solvePnP want them.
# Behaviour: with CORNER_REFINE_APRILTAG they are in those of the AprilTag library, whose first pixel has its middle at
#   (0.5, 0.5): all corners lie half a pixel further right and further down than with the other methods.
# Why it matters: the method is a switch in a file of parameters. All of a marker's corners move together, so that neither
#   the error of reprojection nor the size of the marker shows it: poses turn by half a pixel, 0.9 mm at 1 m with a focal
#   length of 570 pixels, and calibrations move the principal point.
# Seen 2026-11-30, mean over 200 markers whose places are known, in both versions: NONE and SUBPIX are within 0.02 pixels of
#   them, APRILTAG is 0.49 pixels further right and 0.51 further down.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
for version in 5.0.0.93 4.13.0.92; do
  python3 -m venv "venv-$version"
  "venv-$version/bin/pip" install --quiet --disable-pip-version-check "opencv-python-headless==$version"
  "venv-$version/bin/python" - <<'PYTHON'
import cv2
import numpy as np

DICTIONARY = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
CELLS, FINE, WIDTH, HEIGHT = 8, 8, 320, 240  # FINE: parts of a pixel's side
METHODS = {name: getattr(cv2.aruco, f"CORNER_REFINE_{name}") for name in ("NONE", "SUBPIX", "APRILTAG")}


def image_of(marker: int, left: int, top: int, cell: int) -> np.ndarray:
    """Return the image of a marker; place and size of a cell in parts of a pixel."""
    fine = np.full((HEIGHT * FINE, WIDTH * FINE), 255.0)
    cells = cv2.aruco.generateImageMarker(DICTIONARY, marker, CELLS)
    fine[top : top + CELLS * cell, left : left + CELLS * cell] = np.kron(cells, np.ones((cell, cell)))
    return fine.reshape(HEIGHT, FINE, WIDTH, FINE).mean(axis=(1, 3)).round().astype(np.uint8)


random = np.random.default_rng(1)
errors: dict[str, list[np.ndarray]] = {name: [] for name in METHODS}
for marker in range(200):
    left, top, cell = (int(random.integers(*each)) for each in ((300, 700), (300, 700), (48, 120)))
    image = image_of(marker, left, top, cell)
    middle = np.array((left, top)) / FINE + CELLS * cell / FINE / 2 - 0.5  # (0, 0) is the middle of the first pixel
    for name, method in METHODS.items():
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = method
        corners, _, _ = cv2.aruco.ArucoDetector(DICTIONARY, parameters).detectMarkers(image)
        if len(corners) == 1:
            errors[name].append(corners[0][0].mean(axis=0) - middle)
means = {name: np.mean(each, axis=0) for name, each in errors.items()}
for name, mean in means.items():
    print(f"OpenCV {cv2.__version__}, {name}: {mean.round(2)} pixels from the truth, {len(errors[name])} markers")
assert np.abs(means["NONE"]).max() < 0.1
assert np.abs(means["SUBPIX"]).max() < 0.1
assert np.abs(means["APRILTAG"] - 0.5).max() < 0.15
PYTHON
done
