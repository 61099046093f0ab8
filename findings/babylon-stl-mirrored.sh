#!/usr/bin/env bash
# Packages: @babylonjs/core 9.35.0 and @babylonjs/serializers 9.28.0 (npm).
# Wrong belief: an STL file of a scene has the shapes of the scene.
# Behaviour: STLExport swaps y and z, which is right for Babylon's left-handed scenes. It does the same in scenes with
#   useRightHandedSystem, whose parts are mirrored in the file. Its OBJ and glTF exporters know both kinds.
# Why it matters: scenes of glTF files are often right-handed. Triangles and normals are consistent, so that no check of
#   the file finds it: a left-hand thread, text from behind, or a part that does not fit comes out of the printer.
# Seen 2026-11-30: three boxes along x, y and z, seen from +1 +1 +1, have the order of a mirror image in the STL file of the
#   right-handed scene, and the scene's own in that of the left-handed one, and in OBJ files of both.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund @babylonjs/core@9.35.0 @babylonjs/serializers@9.28.0 >/dev/null
cat >export.mjs <<'JAVASCRIPT'
import { MeshBuilder, NullEngine, Scene } from "@babylonjs/core/index.js";
import { OBJExport, STLExport } from "@babylonjs/serializers/index.js";

// Boxes of three sizes, so that each is found again in a file.
const sizes = [0.1, 0.2, 0.3];

function boxes(isRightHanded) {
  const scene = new Scene(new NullEngine());
  scene.useRightHandedSystem = isRightHanded;
  return sizes.map((size, axis) => {
    const box = MeshBuilder.CreateBox(String(size), { size }, scene);
    box.position.fromArray([0, 1, 2].map((k) => (k === axis ? 1 : 0)));
    return box;
  });
}

/** Return the middles of boxes of 12 triangles each, in the order of the file. */
function middles(points) {
  const mean = (values) => values.reduce((a, b) => a + b) / values.length;
  const perBox = points.length / sizes.length;
  return sizes.map((_, k) => [0, 1, 2].map((c) => mean(points.slice(k * perBox, (k + 1) * perBox).map((p) => p[c]))));
}

/** Return 1 if three places on the axes are in a right-handed order, -1 for a left-handed one. */
function handedness([a, b, c]) {
  const cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  return Math.sign(cross[0] * c[0] + cross[1] * c[1] + cross[2] * c[2]);
}

const numbers = (text, keyword) =>
  text.split("\n").map((line) => line.trim().split(/\s+/)).filter((words) => words[0] === keyword)
    .map((words) => words.slice(1, 4).map(Number));

const found = {};
for (const isRightHanded of [false, true]) {
  const stl = STLExport.CreateSTL(boxes(isRightHanded), false);
  const obj = OBJExport.OBJ(boxes(isRightHanded), false, "", true);
  found[isRightHanded] = {
    stl: handedness(middles(numbers(stl, "vertex"))),
    obj: handedness(middles(numbers(obj, "v"))),
  };
}
console.log("handedness of x, y and z in files of left-handed scenes:", found.false, "right-handed:", found.true);
// In a right-handed file, the axes of a left-handed scene are in a left-handed order.
const isAsSeen = found.false.stl === -1 && found.false.obj === -1 && found.true.obj === 1 && found.true.stl === -1;
process.exit(isAsSeen ? 0 : 1);
JAVASCRIPT
node export.mjs
