#!/usr/bin/env bash
# Package: trimesh 5.2.0.
# Wrong belief: vertex colours that trimesh loads from PLY or OBJ look the same in the GLB that it writes.
# Behaviour: the bytes are written as they are to COLOR_0, which is linear by glTF 2.0, 3.7.2.1, while colours of PLY and
#   OBJ are sRGB: the middle grey 128 is shown as 188.
# Why it matters: all colours are paler than in the source, in viewers that follow the specification.
# Seen 2026-11-29: 128 is stored as 128 of 255, which is shown as 188.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check numpy==2.4.6 trimesh==5.2.0

venv/bin/python - <<'PYTHON'
import json

import numpy as np
import trimesh

mesh = trimesh.creation.box()
mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=[128, 128, 128, 255])
data = mesh.export(file_type="glb")
json_size = int.from_bytes(data[12:16], "little")
document = json.loads(data[20 : 20 + json_size])
accessor = document["accessors"][document["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]
view = document["bufferViews"][accessor["bufferView"]]
start = 20 + json_size + 8 + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
stored = data[start]
linear = stored / 255
shown = round(255 * (1.055 * linear ** (1 / 2.4) - 0.055))
print(f"128 is stored as {stored} of 255, which is shown as {shown}")
assert (accessor["componentType"], accessor["normalized"], stored, shown) == (5121, True, 128, 188)
PYTHON
