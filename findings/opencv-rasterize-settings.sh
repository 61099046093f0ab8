#!/usr/bin/env bash
# Package: opencv-python-headless 5.0.0.93 (cv2.triangleRasterize).
# Wrong belief: settings that are made and passed as they are mean the same as none, as the documentation's defaults say: shaded, and
#   clockwise triangles left out.
# Behaviour: in Python, TriangleRasterizeSettings() begins with zeros, which are the names of others: all is white, and drawn from both
#   sides. Without the argument the defaults hold.
# Why it matters: who changes the culling loses the colours, and who changes the shading sees the backs.
# Seen 2026-12-01: one triangle by its first corner's colour: red without settings, white with; from behind: nothing, and all of it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check opencv-python-headless==5.0.0.93 numpy==2.4.6
venv/bin/python - <<'PYTHON'
import cv2
import numpy as np

CORNERS = np.array([[-1, -1, -2], [1, -1, -2], [0, 1, -2]], np.float32)
RED = np.tile(np.array([1, 0, 0], np.float32), (3, 1))


def colours(order, *settings):
    """Return the colours of the pixels that are drawn, and how many there are."""
    colour, depth = np.zeros((90, 120, 3), np.float32), np.full((90, 120), 100, np.float32)
    indices = np.array([order], np.int32)
    cv2.triangleRasterize(CORNERS, indices, RED, colour, depth, np.eye(4, dtype=np.float32), 1.0, 0.1, 100.0, *settings)
    drawn = depth < 100
    return np.unique(colour[drawn].round(3), axis=0).tolist(), int(drawn.sum())


front, back = (0, 1, 2), (0, 2, 1)
without = colours(front), colours(back)
default = cv2.TriangleRasterizeSettings()
passed = colours(front, default), colours(back, default)
print(without, passed)
assert without[0][0] == [[1, 0, 0]] and without[1][1] == 0
assert passed[0][0] == [[1, 1, 1]] and passed[1][1] == passed[0][1] == without[0][1] > 1000
shaded = cv2.TriangleRasterizeSettings().setShadingType(cv2.RASTERIZE_SHADING_SHADED)
assert colours(front, shaded)[0] == [[1, 0, 0]] and colours(back, shaded)[1] > 1000
PYTHON
