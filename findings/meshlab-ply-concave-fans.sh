#!/usr/bin/env bash
# Package: pymeshlab 2025.7.post1 (MeshLab).
# Wrong belief: the same polygon is the same surface, whichever format it is read from.
# Behaviour: concave polygons of OBJ files keep their shape; those of PLY files become fans, which cover what is outside.
# Why it matters: a mesh of polygons that goes through PLY, as Blender writes it, has wrong areas and overlapping triangles.
# Seen 2026-11-29: an L of three unit squares has an area of 3.0 from OBJ, 4.0 from PLY.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 pymeshlab==2025.7.post1

venv/bin/python - <<'PYTHON'
from pathlib import Path

import pymeshlab

ROWS = [f"{x} {y} 0" for x, y in ((2, 1), (1, 1), (1, 2), (0, 2), (0, 0), (2, 0))]
Path("l.obj").write_text("".join(f"v {row}\n" for row in ROWS) + "f 1 2 3 4 5 6\n")
header = ["ply", "format ascii 1.0", "element vertex 6", *(f"property float {axis}" for axis in "xyz")]
header += ["element face 1", "property list uchar int vertex_indices", "end_header"]
Path("l.ply").write_text("\n".join([*header, *ROWS, "6 0 1 2 3 4 5", ""]))
areas = {}
for name in ("l.obj", "l.ply"):
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(name)
    areas[name] = round(meshes.get_geometric_measures()["surface_area"], 6)
print(areas)
assert areas == {"l.obj": 3.0, "l.ply": 4.0}
PYTHON
