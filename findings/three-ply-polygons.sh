#!/usr/bin/env bash
# Package: three 0.187 (npm), PLYLoader.
# Wrong belief: the loader reads faces of any number of corners, or says that it does not.
# Behaviour: faces of five and more corners are left out, without a word. A mesh of nothing else has no index at all, so that its
#   vertices are drawn in threes, as they come.
# Why it matters: Blender writes polygons into PLY files as they are; in the browser the surface has holes.
# Seen 2026-11-29: indices by the number of corners of a face: 3 for 3, 6 for 4, none for 5 and for 8.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund three@0.187.0 > /dev/null
cat > polygons.mjs <<'JAVASCRIPT'
import assert from 'node:assert'
import { PLYLoader } from 'three/examples/jsm/loaders/PLYLoader.js'

const counts = {}
for (const corners of [3, 4, 5, 8]) {
  const header = ['ply', 'format ascii 1.0', `element vertex ${corners}`, 'property float x', 'property float y', 'property float z']
  header.push('element face 1', 'property list uchar int vertex_indices', 'end_header')
  const numbers = [...Array(corners).keys()]
  const rows = numbers.map((number) => `${Math.cos((2 * Math.PI * number) / corners)} ${Math.sin((2 * Math.PI * number) / corners)} 0`)
  const text = [...header, ...rows, [corners, ...numbers].join(' '), ''].join('\n')
  counts[corners] = new PLYLoader().parse(text).index?.count ?? 0
}
console.log(counts)
assert.deepStrictEqual(counts, { 3: 3, 4: 6, 5: 0, 8: 0 })
JAVASCRIPT
node polygons.mjs
