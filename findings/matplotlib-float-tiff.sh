#!/usr/bin/env bash
# Package: matplotlib 3.11.2, with Pillow 13.0.0.
# Wrong belief: pyplot.imread returns the values of a TIFF file, in its bit depth, as its documentation says of all but PNG.
# Behaviour: grey images of 32 bits, float or integer, become 8-bit RGBA: values are cut to whole numbers from 0 to 255, without a
#   warning. Those of 16 bits are read as they are.
# Why it matters: depth images in metres, as BlenderProc's, Drake's and GIS tools' TIFF files, come back in whole metres: 1.9 m is 1,
#   infinity 255, and four channels are drawn as colours. Pillow, tifffile and OpenCV read the same file exactly.
# Seen 2026-11-30: 0.5, 1.9, 300.25 m and infinity are read as 0, 1, 255 and 255.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check matplotlib==3.11.2 pillow==13.0.0 tifffile==2026.3.3

cat >read.py <<'PYTHON'
import numpy as np
import tifffile
from matplotlib import pyplot
from PIL import Image

depth = np.array([[0.5, 1.9, 300.25, np.inf]], np.float32)
tifffile.imwrite("depth.tiff", depth)
assert np.array_equal(np.asarray(Image.open("depth.tiff")), depth)
read = pyplot.imread("depth.tiff")
print(read.dtype, read.tolist())
assert read.dtype == np.uint8
assert read.shape == (1, 4, 4)
assert read[0, :, 0].tolist() == [0, 1, 255, 255]

millimetres = np.array([[500, 1900, 60000]], np.uint16)
tifffile.imwrite("millimetres.tiff", millimetres)
assert np.array_equal(pyplot.imread("millimetres.tiff"), millimetres)
PYTHON
venv/bin/python read.py
