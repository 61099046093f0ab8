#!/usr/bin/env bash
# Package: cadquery 2.8.0 (and 2.7.0).
# Wrong belief: a part that is modelled in millimetres, CadQuery's unit in STEP files, has its size in the GLB file, too.
# Behaviour: the numbers are written as they are; glTF 2.0, 3.4, says that they are metres. STEP files state millimetres.
# Why it matters: a box of 100 mm is 100 m wide in every viewer and simulator, and physics with it is off by 1e9 in mass.
# Seen 2026-11-29: a box of 100 mm is 100 wide in the GLB file, without a node that scales; the STEP file says MILLI METRE.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check cadquery==2.8.0

venv/bin/python - <<'PYTHON'
import json

import cadquery

box = cadquery.Workplane().box(100, 100, 100)
assembly = cadquery.Assembly(box)
assembly.export("box.glb")
assembly.export("box.step")
data = open("box.glb", "rb").read()
document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
primitives = [each for mesh in document["meshes"] for each in mesh["primitives"]]
accessors = [document["accessors"][each["attributes"]["POSITION"]] for each in primitives]
width = max(each["max"][0] for each in accessors) - min(each["min"][0] for each in accessors)
scales = [node for node in document["nodes"] if "scale" in node or "matrix" in node]
print(f"a box of 100 mm is {width:g} wide in the GLB file, {len(scales)} nodes have a scale or matrix")
assert round(width, 3) == 100
assert not scales
assert "SI_UNIT(.MILLI.,.METRE.)" in open("box.step").read()
PYTHON
