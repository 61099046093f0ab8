#!/usr/bin/env bash
# Package: pyvista 0.49.1, vtk 9.7.2.
# Wrong belief: mesh.area is the area of what is drawn.
# Behaviour: the area of a concave polygon is that of a fan of triangles; triangulate(), and the renderer, cut it as it is.
# Why it matters: areas of cells, and what is weighted by them, are wrong for outlines of parts, texts and floor plans.
# Seen 2026-11-29: an L of three unit squares has an area of 4.0, and of 3.0 after triangulate().
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pyvista==0.49.1 vtk==9.7.2

venv/bin/python - <<'PYTHON'
import pyvista

corners = [(2, 1, 0), (1, 1, 0), (1, 2, 0), (0, 2, 0), (0, 0, 0), (2, 0, 0)]
notched = pyvista.PolyData([tuple(map(float, corner)) for corner in corners], faces=[6, 0, 1, 2, 3, 4, 5])
areas = round(notched.area, 6), round(notched.triangulate().area, 6)
print(areas)
assert areas == (4.0, 3.0)
PYTHON
