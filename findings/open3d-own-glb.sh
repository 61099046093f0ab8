#!/usr/bin/env bash
# Package: open3d 0.20.0.
# Wrong belief: what write_triangle_mesh writes, read_triangle_mesh reads.
# Behaviour: a GLB file gets a data URI in place of the binary chunk. The reader (ASSIMP) finds the buffer empty, warns, and returns a
#   mesh without vertices. The same mesh as .gltf is read.
# Why it matters: a script that saves and loads GLB files goes on with an empty mesh.
# Seen 2026-11-29: 8 vertices of 8 from box.gltf, 0 from box.glb.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check open3d==0.20.0 libusb-package==1.0.30.0
# Open3D needs libusb-1.0, also without a camera.
ln -s "$(venv/bin/python -c 'import libusb_package; print(libusb_package.get_library_path())')" libusb-1.0.so.0

LD_LIBRARY_PATH=$folder venv/bin/python - <<'PYTHON'
import open3d

box = open3d.geometry.TriangleMesh.create_box()
counts = {}
for name in ("box.gltf", "box.glb"):
    assert open3d.io.write_triangle_mesh(name, box)
    counts[name] = len(open3d.io.read_triangle_mesh(name).vertices)
print(counts)
assert counts == {"box.gltf": 8, "box.glb": 0}
PYTHON
