#!/usr/bin/env bash
# Package: trimesh 5.2.0.
# Wrong belief: a tab separates the words of an OBJ file as a blank does.
# Behaviour: faces of lines that begin with f and a tab are passed over; the result is a cloud of the vertices.
# Why it matters: the mesh of a valid file is empty, without an error; a collision mesh of it never collides.
# Seen 2026-11-29: Trimesh with blanks, PointCloud with tabs behind f.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 trimesh==5.2.0

venv/bin/python - <<'PYTHON'
import io

import trimesh

text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
kinds = []
for data in (text, text.replace("f ", "f\t")):
    scene = trimesh.load_scene(io.BytesIO(data.encode()), file_type="obj")
    kinds += [type(geometry).__name__ for geometry in scene.geometry.values()]
print(kinds)
assert kinds == ["Trimesh", "PointCloud"]
PYTHON
