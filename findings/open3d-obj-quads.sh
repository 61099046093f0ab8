#!/usr/bin/env bash
# Package: open3d 0.20.0.
# Wrong belief: read_triangle_mesh reads a mesh of quads, as it reads one of triangles.
# Behaviour: from an OBJ file all faces of four and more corners are left out, with a line of information and an empty mesh; the
#   same face in a PLY file, and the same OBJ file through open3d.t.io, has its triangles.
# Why it matters: most modelling programs write quads into OBJ files. A box of six quads has eight vertices and no surface.
# Seen 2026-11-29: 0 triangles from box.obj, 12 through open3d.t.io.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check open3d==0.20.0 libusb-package==1.0.30.0
# Open3D needs libusb-1.0, also without a camera.
ln -s "$(venv/bin/python -c 'import libusb_package; print(libusb_package.get_library_path())')" libusb-1.0.so.0
cat > box.obj <<'OBJ'
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 1 4 3 2
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
OBJ

LD_LIBRARY_PATH=$folder venv/bin/python - <<'PYTHON'
import open3d

legacy = open3d.io.read_triangle_mesh("box.obj")
tensor = open3d.t.io.read_triangle_mesh("box.obj")
counts = len(legacy.triangles), len(tensor.triangle.indices)
print(counts)
assert counts == (0, 12)
PYTHON
