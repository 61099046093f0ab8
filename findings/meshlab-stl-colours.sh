#!/usr/bin/env bash
# Package: pymeshlab 2025.7.post1 (MeshLab); read with three 0.187 (npm), STLLoader.
# Wrong belief: colours of triangles in STL files, in the form of Materialise Magics, mean the same to all who read that form.
# Behaviour: MeshLab writes the header `COLOR=` of Magics, by default, and sets the highest bit of the triangles' two bytes. In files
#   with that header a set bit means: the object's colour, which is in the header, a grey. three.js follows that, MeshLab ignores it.
# Why it matters: coloured scans come out grey, from a file that MeshLab shows in colour.
# Seen 2026-11-29: bytes 0x8019 for a triangle with a red of 25/31; three.js gives all corners the header's grey.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet --disable-pip-version-check pymeshlab==2025.7.post1
npm install --silent --no-audit --no-fund three@0.187.0 > /dev/null

venv/bin/python - <<'PYTHON'
from pathlib import Path

import pymeshlab

meshes = pymeshlab.MeshSet()
meshes.create_cube()
meshes.compute_color_by_function_per_face(r="200", g="0", b="0", a="255")
meshes.save_current_mesh("cube.stl")
data = Path("cube.stl").read_bytes()
print(data[:20], hex(int.from_bytes(data[132:134], "little")))
assert data.startswith(b"COLOR=\x7f\x7f\x7f")
assert int.from_bytes(data[132:134], "little") == 0x8000 | 25
PYTHON
cat > colours.mjs <<'JAVASCRIPT'
import assert from 'node:assert'
import { readFileSync } from 'node:fs'
import { Color } from 'three'
import { STLLoader } from 'three/examples/jsm/loaders/STLLoader.js'

const { attributes } = new STLLoader().parse(new Uint8Array(readFileSync('cube.stl')).buffer)
const colours = new Set()
for (let corner = 0; corner < attributes.color.count; corner++) {
  colours.add(new Color().fromBufferAttribute(attributes.color, corner).getHexString())
}
console.log([...colours])
assert.deepStrictEqual([...colours], ['7f7f7f'])
JAVASCRIPT
node colours.mjs
