#!/usr/bin/env bash
# Package: usd2gltf 0.3.5 with usd-core 26.11.
# Wrong belief: a converter turns the up axis and the unit that a stage states into glTF's, Y up and metres.
# Behaviour: it copies the points of a Z-up stage in centimetres as they are.
# Why it matters: robots and scenes of Isaac Sim (Z up) and of other tools (centimetres) lie, or are a hundred times too large.
# Seen 2026-11-29: a triangle from z = 0 to 100 cm spans z = 0 to 100 m.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check usd2gltf==0.3.5 usd-core==26.11

cat >stage.usda <<'USDA'
#usda 1.0
(
    defaultPrim = "pole"
    metersPerUnit = 0.01
    upAxis = "Z"
)
def Mesh "pole" {
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (10, 0, 0), (0, 0, 100)]
    uniform token subdivisionScheme = "none"
}
USDA
venv/bin/usd2gltf -i stage.usda -o stage.gltf >log.txt
venv/bin/python - <<'PYTHON'
import json

document = json.load(open("stage.gltf"))
transforms = [node for node in document["nodes"] if {"matrix", "rotation", "scale"} & node.keys()]
highest = next(each["max"] for each in document["accessors"] if each["type"] == "VEC3" and max(each.get("max", [0])) > 1)
print(highest, transforms)
assert highest == [10.0, 0.0, 100.0] and not transforms
PYTHON
