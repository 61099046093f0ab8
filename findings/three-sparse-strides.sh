#!/usr/bin/env bash
# Package: three 0.187 (npm), GLTFLoader.
# Wrong belief: a sparse accessor changes some values of the accessor below it, whatever the stride of that one's buffer view.
# Behaviour: the values below are read as if they lay side by side: bytes of padding, or of the next attribute, become coordinates. Without
#   `sparse` the same buffer view is read with its stride. Nothing is logged.
# Why it matters: vertices of interleaved buffers, and all of three bytes or shorts, have a stride: glTF wants multiples of four bytes. The
#   mesh is torn, and nothing says why; other viewers show the file as it is meant.
# Seen 2026-11-30: x, y, z of four vertices of shorts, 1 2 3, 4 5 6, 7 8 9, 10 11 12 with a stride of 8 bytes, of which the last is replaced
#   by 100 110 120: 1 2 3, 0 4 5, 6 0 7, 100 110 120; without sparse 1 2 3, 4 5 6, 7 8 9, 10 11 12.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund three@0.187.0 > /dev/null
cat > sparse.mjs <<'JAVASCRIPT'
import assert from 'node:assert'
import { GLTFLoader } from 'three/examples/jsm/loaders/GLTFLoader.js'

globalThis.ProgressEvent ??= Event // browsers have it, Node.js does not

// Four vertices of three shorts and two bytes of padding, then the values and the index of the sparse accessor.
const shorts = [[1, 2, 3, 0], [4, 5, 6, 0], [7, 8, 9, 0], [10, 11, 12, 0], [100, 110, 120, 0], [3, 0]].flat()
const bytes = Buffer.from(new Int16Array(shorts).buffer)

async function positions(sparse) {
  const max = sparse.sparse ? [100, 110, 120] : [10, 11, 12]
  const accessor = { componentType: 5122, count: 4, type: 'VEC3', min: [1, 2, 3], max, bufferView: 0, ...sparse }
  const document = {
    asset: { version: '2.0' },
    extensionsUsed: ['KHR_mesh_quantization'],
    extensionsRequired: ['KHR_mesh_quantization'],
    buffers: [{ byteLength: bytes.length, uri: `data:application/octet-stream;base64,${bytes.toString('base64')}` }],
    bufferViews: [
      { buffer: 0, byteLength: 32, byteStride: 8, target: 34962 },
      { buffer: 0, byteOffset: 32, byteLength: 6 },
      { buffer: 0, byteOffset: 40, byteLength: 2 },
    ],
    accessors: [accessor],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, mode: 0 }] }],
    nodes: [{ mesh: 0 }],
    scenes: [{ nodes: [0] }],
    scene: 0,
  }
  const gltf = await new GLTFLoader().parseAsync(JSON.stringify(document), '')
  const { position } = gltf.scene.children[0].geometry.attributes
  return [0, 1, 2, 3].map((number) => [position.getX(number), position.getY(number), position.getZ(number)].join(' '))
}

const sparse = { sparse: { count: 1, indices: { bufferView: 2, componentType: 5123 }, values: { bufferView: 1 } } }
const [plain, changed] = [await positions({}), await positions(sparse)]
console.log(plain, changed)
assert.deepStrictEqual(plain, ['1 2 3', '4 5 6', '7 8 9', '10 11 12'])
assert.deepStrictEqual(changed, ['1 2 3', '0 4 5', '6 0 7', '100 110 120'])
JAVASCRIPT
node sparse.mjs
