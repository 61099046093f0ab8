#!/usr/bin/env bash
# Package: DracoPy 2.2.0.
# Wrong belief: positions are the first attribute of a compressed mesh, with the unique id 0.
# Behaviour: with colours, these have the id 0 and positions 1; without colours positions have 0.
# Why it matters: KHR_draco_mesh_compression of glTF names attributes by these ids. Written as { POSITION: 0, COLOR_0: 1 }, colours
#   are read as positions, without an error.
# Seen 2026-11-29: ids {'POSITION': 0} without and {'COLOR': 0, 'POSITION': 1} with colours.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 DracoPy==2.2.0

venv/bin/python - <<'PYTHON'
import DracoPy
import numpy as np

names = {0: "POSITION", 2: "COLOR"}
points, faces = np.eye(3, dtype=np.float32), np.array([[0, 1, 2]])
colors = np.array([[200, 60, 40]] * 3, np.uint8)
ids = []
for options in ({}, {"colors": colors}):
    mesh = DracoPy.decode(DracoPy.encode(points, faces, **options))
    ids.append({names[each["attribute_type"]]: each["unique_id"] for each in mesh.attributes})
print(*ids)
assert ids == [{"POSITION": 0}, {"COLOR": 0, "POSITION": 1}]
PYTHON
