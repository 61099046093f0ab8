#!/usr/bin/env bash
# Package: vtk 9.7.2, through pyvista 0.49.1.
# Wrong belief: a mesh whose cells have colours is exported to glTF with those colours.
# Behaviour: COLOR_0 has one entry for each triangle (12 for a box), while POSITION has one for each vertex (8). glTF 2.0,
#   3.7.2.1, wants the same number. Nothing warns.
# Why it matters: readers refuse the file, drop the colours, or give the vertices the colours of other triangles.
# Seen 2026-11-29: COLOR_0 12, NORMAL 8, POSITION 8, TEXCOORD_0 8 entries.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pyvista==0.49.1 vtk==9.7.2

venv/bin/python - <<'PYTHON'
import json

import numpy as np
import pyvista

plotter = pyvista.Plotter(off_screen=True)
box = pyvista.Cube()
box.cell_data["colours"] = np.arange(18, dtype=np.uint8).reshape(6, 3) * 10
plotter.add_mesh(box, scalars="colours", rgb=True)
plotter.export_gltf("box.gltf")
document = json.load(open("box.gltf"))
(primitive,) = document["meshes"][0]["primitives"]
count = {name: document["accessors"][index]["count"] for name, index in primitive["attributes"].items()}
print(count)
triangles = document["accessors"][primitive["indices"]]["count"] // 3
assert count["COLOR_0"] == triangles == 12
assert count["POSITION"] == 8
PYTHON
