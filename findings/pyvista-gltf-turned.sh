#!/usr/bin/env bash
# Package: pyvista 0.49.1.
# Wrong belief: export_gltf, which makes Z up to glTF's Y up, leaves the scene as it is for programs that make Z up of it again.
# Behaviour: x, y and z become z, x and y. The usual way is x, z and -y, which Blender and others undo: what lay along +x
#   lies along -y for them.
# Why it matters: scenes stand, but are turned by -90 degrees about the vertical, beside others that were exported elsewhere.
# Seen 2026-11-29: a box at x = 5 is at (0, -5, 0) after the usual turn back.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pyvista==0.49.1 vtk==9.7.2

venv/bin/python - <<'PYTHON'
import base64
import json

import numpy as np
import pyvista

plotter = pyvista.Plotter(off_screen=True)
plotter.add_mesh(pyvista.Cube(center=(5, 0, 0)))
plotter.export_gltf("box.gltf")
document = json.load(open("box.gltf"))
(primitive,) = document["meshes"][0]["primitives"]
accessor = document["accessors"][primitive["attributes"]["POSITION"]]
view = document["bufferViews"][accessor["bufferView"]]
data = base64.b64decode(document["buffers"][view["buffer"]]["uri"].partition(",")[2])
start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
points = np.frombuffer(data, np.float32, 3 * accessor["count"], start).reshape(-1, 3)
(index,) = [number for number, node in enumerate(document["nodes"]) if node.get("mesh") == 0]
matrix = np.eye(4)
while index is not None:  # from the node with the mesh up to the root
    matrix = np.reshape(document["nodes"][index].get("matrix", np.eye(4)), (4, 4)).T @ matrix
    index = next((n for n, node in enumerate(document["nodes"]) if index in node.get("children", ())), None)
x, y, z = points.mean(axis=0) @ matrix[:3, :3].T + matrix[:3, 3]
back = np.round((x, -z, y), 6) + 0.0
print("a box at x = 5 is at", back.tolist(), "after the usual turn back")
assert back.tolist() == [0, -5, 0]
PYTHON
