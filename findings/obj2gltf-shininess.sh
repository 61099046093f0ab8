#!/usr/bin/env bash
# Package: obj2gltf 3.2.0 (npm, Cesium).
# Wrong belief: the exponent `Ns` of an MTL file becomes the roughness whose highlight is as wide, sqrt(2 / (Ns + 2)): 0.14 for 96.
# Behaviour: the roughness is 1 - Ns / 1000. If the luminance of `Ks` is below 0.1, it is multiplied by 1 less the luminance: fainter
#   highlights get sharper, where the comment in the code says rougher.
# Why it matters: exponents of most files are below 250, so that all that shone comes out matte. Blender writes 250 for a roughness of
#   0.5, which comes back as 0.75.
# Seen 2026-12-01: 0.99, 0.904 and 0.75 for an Ns of 10, 96 and 250; 0.1 for 900, and 0.095 with a grey Ks of 0.05.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund --ignore-scripts obj2gltf@3.2.0 cesium@1.140.0 @cesium/engine@24.0.0 \
  @cesium/widgets@14.5.0 bluebird@3.7.2 fs-extra@11.4.1 jpeg-js@0.4.4 mime@3.0.0 pngjs@7.0.0 yargs@17.7.3 > /dev/null
cat > shininess.cjs <<'JAVASCRIPT'
const assert = require('node:assert')
const fs = require('node:fs')
const obj2gltf = require('obj2gltf')

async function roughness(Ns, Ks) {
  fs.writeFileSync('a.mtl', `newmtl m\nKd 0.5 0.5 0.5\nKs ${Ks} ${Ks} ${Ks}\nNs ${Ns}\n`)
  fs.writeFileSync('a.obj', 'mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n')
  return (await obj2gltf('a.obj')).materials[0].pbrMetallicRoughness.roughnessFactor
}

async function main() {
  for (const [Ns, Ks, expected] of [[10, 0.5, 0.99], [96, 0.5, 0.904], [250, 0.5, 0.75], [900, 0.5, 0.1], [900, 0.05, 0.095]]) {
    const found = await roughness(Ns, Ks)
    console.log(`Ns ${Ns}, Ks ${Ks}: roughness ${found}`)
    assert(Math.abs(found - expected) < 1e-6)
  }
}
main().catch((error) => { console.error(error); process.exit(1) })
JAVASCRIPT
node shininess.cjs
