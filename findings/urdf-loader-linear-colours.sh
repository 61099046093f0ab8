#!/usr/bin/env bash
# Package: urdf-loader 0.13.1 (npm), three 0.187.
# Wrong belief: half grey of a URDF file is half grey on a web page, #808080, as in RViz.
# Behaviour: the loader gives the numbers to Color.setRGB, which takes them for linear since three 0.152: it is #bcbcbc. Textures of
#   the same file are marked as sRGB, and three's ColladaLoader, which it calls for meshes, takes the same numbers for sRGB.
# Why it matters: links with a <material> are paler than those with coloured meshes; dark greys, as of grippers, suffer most.
# Seen 2026-12-01: 0.5 is #bcbcbc in the URDF file, #808080 in the COLLADA file; 0.1 is #595959 and #1a1a1a.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund three@0.187.0 urdf-loader@0.13.1 @xmldom/xmldom@0.9.12 > /dev/null
cat > colours.mjs <<'JAVASCRIPT'
import assert from 'node:assert'
import { Document, DOMParser, Element, Node } from '@xmldom/xmldom'
import { ColladaLoader } from 'three/examples/jsm/loaders/ColladaLoader.js'
import URDFLoader from 'urdf-loader'

// What the loaders need of a browser.
Object.assign(globalThis, { Document, DOMParser, Element })
Object.defineProperty(Node.prototype, 'children', { get() { return [...this.childNodes].filter((node) => node.nodeType === 1) } })
Node.prototype.querySelector = () => null // it looks for the joint of a link, which has none here

const urdf = (value) => `<robot name="r"><link name="a"><visual>
  <geometry><box size="1 1 1"/></geometry>
  <material name="grey"><color rgba="${value} ${value} ${value} 1"/></material>
</visual></link></robot>`

const collada = (value) => `<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>
<library_effects><effect id="e"><profile_COMMON><technique sid="t"><lambert>
  <diffuse><color>${value} ${value} ${value} 1</color></diffuse>
</lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
  <source id="p"><float_array id="f" count="9">0 0 0 1 0 0 0 1 0</float_array>
    <technique_common><accessor source="#f" count="3" stride="3"/></technique_common></source>
  <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
  <triangles material="s" count="1"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="x"><node><instance_geometry url="#g">
  <bind_material><technique_common><instance_material symbol="s" target="#m"/></technique_common></bind_material>
</instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#x"/></scene></COLLADA>`

function colour(object) {
  const colours = []
  object.traverse((each) => each.isMesh && colours.push([each.material].flat()[0].color.getHexString()))
  assert.strictEqual(colours.length, 1)
  return colours[0]
}

const seen = ['0.5', '0.1'].map((value) => [
  colour(new URDFLoader().parse(new DOMParser().parseFromString(urdf(value), 'text/xml'))),
  colour(new ColladaLoader().parse(collada(value)).scene),
])
console.log(seen)
assert.deepStrictEqual(seen, [['bcbcbc', '808080'], ['595959', '1a1a1a']])
JAVASCRIPT
node colours.mjs
