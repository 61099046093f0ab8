#!/usr/bin/env bash
# Package: compas 2.15.1 (COMPAS).
# Wrong belief: `Mesh.to_stl` writes a mesh where it is, as `to_obj` does.
# Behaviour: if any coordinate is below 0, the mesh of a text STL file, its default, is moved so that its least x, y and z are 0. That of
#   a binary one is not.
# Why it matters: parts that are written one by one all come to lie in one corner, and do not fit each other any more. The first STL
#   specification wanted positive coordinates; readers take any.
# Seen 2026-12-01: a box from (4, -1, -1) to (6, 1, 1) is from (0, 0, 0) to (2, 2, 2) in text, and in place in binary and OBJ files.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check compas==2.15.1 numpy==2.4.6 scipy==1.17.1 networkx==3.6.1 watchdog==7.1.0 \
  jsonschema==4.26.0 attrs==26.1.0 jsonschema-specifications==2025.9.1 referencing==0.37.0 rpds-py==2026.9.1 typing_extensions==4.16.0

venv/bin/python - <<'PYTHON'
import numpy as np
from compas.datastructures import Mesh
from compas.geometry import Box, Frame

box = Mesh.from_shape(Box(2, 2, 2, frame=Frame([5, 0, 0], [1, 0, 0], [0, 1, 0])))
mesh = Mesh.from_vertices_and_faces(*box.to_vertices_and_faces(triangulated=True))
mesh.to_stl("text.stl")
mesh.to_stl("binary.stl", binary=True)
mesh.to_obj("mesh.obj")


def bounds(points):
    points = np.array(points, float).reshape(-1, 3)
    return points.min(axis=0).tolist(), points.max(axis=0).tolist()


def text(path, keyword):
    rows = (line.split() for line in open(path))
    return [row[1:4] for row in rows if row[:1] == [keyword]]


facets = np.fromfile("binary.stl", np.dtype([("normal", "<f4", 3), ("corners", "<f4", 9), ("rest", "<u2")]), offset=84)
found = {
    "text": bounds(text("text.stl", "vertex")),
    "binary": bounds(facets["corners"]),
    "OBJ": bounds(text("mesh.obj", "v")),
}
print(found)
assert found["text"] == ([0, 0, 0], [2, 2, 2])
assert found["binary"] == found["OBJ"] == ([4, -1, -1], [6, 1, 1])
PYTHON
