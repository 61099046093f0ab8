#!/usr/bin/env bash
# Package: @babylonjs/core and @babylonjs/serializers 9.28 (npm), OBJExport.
# Wrong belief: the MTL text of a mesh has the materials that the OBJ text of the same mesh uses.
# Behaviour: OBJ() writes the id of the material behind usemtl, MTL() writes `newmtl mat1` unless it is given that id.
# Why it matters: readers find no material: everything is white or grey, mostly without a word.
# Seen 2026-11-29: usemtl red, newmtl mat1.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund @babylonjs/core@9.28.0 @babylonjs/serializers@9.28.0 > /dev/null
cat > names.mjs <<'JAVASCRIPT'
import assert from 'node:assert'
import { Color3, MeshBuilder, NullEngine, Scene, StandardMaterial } from '@babylonjs/core/index.js'
import { OBJExport } from '@babylonjs/serializers/index.js'

const scene = new Scene(new NullEngine())
const box = MeshBuilder.CreateBox('box', { size: 1 }, scene)
box.material = new StandardMaterial('red', scene)
box.material.diffuseColor = new Color3(1, 0, 0)
const used = /^usemtl (.*)$/m.exec(OBJExport.OBJ([box], true, 'box'))[1]
const defined = /^newmtl (.*)$/m.exec(OBJExport.MTL(box))[1]
console.log(used, defined)
assert.deepEqual([used, defined], ['red', 'mat1'])
process.exit(0) // the engine's timers
JAVASCRIPT
node names.mjs
