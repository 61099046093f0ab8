#!/usr/bin/env bash
# Package: cmeel-assimp 6.0.5 (Assimp 6.0.5; Pinocchio and coal read their meshes with it).
# Wrong belief: colours of vertices without an opacity are opaque, as glTF says of a COLOR_0 with three components.
# Behaviour: Assimp's glTF importer gives them the opacity 0. With four components they are right, and its PLY and OBJ importers give 1.
# Why it matters: whoever blends by the colours' opacity sees nothing, and a file that Assimp converts keeps the 0.
# Seen 2026-11-30: an orange triangle that is converted from glTF to glTF: 1 0.5 0 0 with three components, 1 0.5 0 1 with four.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check cmeel-assimp==6.0.5
assimp=$(echo venv/lib/python3*/site-packages/cmeel.prefix)
export LD_LIBRARY_PATH=$assimp/lib

venv/bin/python - <<'PYTHON'
import base64
import json
import struct

CORNERS = (0, 0, 0, 1, 0, 0, 0, 1, 0)
for components in (3, 4):
    color = (1.0, 0.5, 0.0, 1.0)[:components] * 3
    data = struct.pack(f"<9f{len(color)}f", *CORNERS, *color)
    document = {
        "asset": {"version": "2.0"},
        "buffers": [
            {
                "byteLength": len(data),
                "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            }
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": 36},
            {"buffer": 0, "byteOffset": 36, "byteLength": len(data) - 36},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]},
            {"bufferView": 1, "componentType": 5126, "count": 3, "type": f"VEC{components}"},
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    with open(f"{components}.gltf", "w") as file:
        json.dump(document, file)
PYTHON
for components in 3 4; do
  "$assimp/bin/assimp" export $components.gltf again$components.gltf -fgltf2 > log || { cat log; exit 1; }
done

venv/bin/python - <<'PYTHON'
import json

colors = {}
for components in (3, 4):
    with open(f"again{components}.gltf") as file:
        document = json.load(file)
    (primitive,) = document["meshes"][0]["primitives"]
    accessor = document["accessors"][primitive["attributes"]["COLOR_0"]]
    assert accessor["min"] == accessor["max"]  # all corners are equal
    colors[components] = accessor["max"]
print(colors)
assert colors == {3: [1.0, 0.5, 0.0, 0.0], 4: [1.0, 0.5, 0.0, 1.0]}
PYTHON
