#!/usr/bin/env bash
# Package: three 0.187 (npm), OBJExporter, PLYExporter and STLExporter.
# Wrong belief: a scene that is exported has all that is seen.
# Behaviour: an InstancedMesh is written once, at the place of the object, without the transforms of its instances. GLTFExporter
#   writes them.
# Why it matters: three boxes at x = 5, 6, 7 become one at x = 0, in a file that looks complete.
# Seen 2026-11-29: 24 vertices from -0.5 to 0.5 m in x, in each of the three formats.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund three@0.187.0 > /dev/null
cat > instances.mjs <<'JAVASCRIPT'
import assert from 'node:assert'
import * as THREE from 'three'
import { OBJExporter } from 'three/examples/jsm/exporters/OBJExporter.js'
import { PLYExporter } from 'three/examples/jsm/exporters/PLYExporter.js'
import { STLExporter } from 'three/examples/jsm/exporters/STLExporter.js'
import { OBJLoader } from 'three/examples/jsm/loaders/OBJLoader.js'
import { PLYLoader } from 'three/examples/jsm/loaders/PLYLoader.js'
import { STLLoader } from 'three/examples/jsm/loaders/STLLoader.js'

globalThis.requestAnimationFrame = () => 0 // of browsers, which PLYExporter calls
const boxes = new THREE.InstancedMesh(new THREE.BoxGeometry(1, 1, 1), new THREE.MeshBasicMaterial(), 3)
for (const number of [0, 1, 2]) boxes.setMatrixAt(number, new THREE.Matrix4().makeTranslation(5 + number, 0, 0))
boxes.updateMatrixWorld(true)
const read = {
  obj: new OBJLoader().parse(new OBJExporter().parse(boxes)).children[0].geometry,
  ply: new PLYLoader().parse(new PLYExporter().parse(boxes, () => {}, {})),
  stl: new STLLoader().parse(new STLExporter().parse(boxes)),
}
for (const [format, geometry] of Object.entries(read)) {
  geometry.computeBoundingBox()
  const { min, max } = geometry.boundingBox
  console.log(format, min.x, max.x)
  assert.deepStrictEqual([min.x, max.x], [-0.5, 0.5])
}
JAVASCRIPT
node instances.mjs
