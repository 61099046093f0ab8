#!/usr/bin/env bash
# Package: meshio 5.3.5.
# Wrong belief: an index below 0 in an OBJ file, which counts back from the last vertex, is resolved or refused.
# Behaviour: it stays negative, less one: `f -3 -2 -1` after three vertices has the indices -4 -3 -2. NumPy counts those from the end of
#   all vertices, so that faces have other corners, or an index is out of range.
# Why it matters: OBJ files that are put together from parts count back; each part gets corners of another one, without an error.
# Seen 2026-11-30: the first of two triangles is [-4, -3, -2]; among the six vertices that is 2 3 4 in place of 0 1 2.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check meshio==5.3.5
cat > parts.obj <<'OBJ'
v 0 0 0
v 1 0 0
v 0 1 0
f -3 -2 -1
v 5 0 0
v 6 0 0
v 5 1 0
f -3 -2 -1
OBJ
venv/bin/python - <<'PYTHON'
import meshio
import numpy as np

mesh = meshio.read("parts.obj")
triangles = np.concatenate([block.data for block in mesh.cells])
print(triangles.tolist(), "x of the first:", mesh.points[triangles[0], 0].tolist())
assert triangles.tolist() == [[-4, -3, -2]] * 2
assert mesh.points[triangles[0], 0].tolist() == [0.0, 5.0, 6.0]
PYTHON
