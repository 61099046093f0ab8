import { Document, NodeIO, Logger } from '@gltf-transform/core';
import { ALL_EXTENSIONS, EXTMeshGPUInstancing, EXTMeshoptCompression, KHRDracoMeshCompression } from '@gltf-transform/extensions';
import { meshopt, draco, quantize, reorder } from '@gltf-transform/functions';
import { MeshoptEncoder, MeshoptDecoder } from 'meshoptimizer';
import draco3d from 'draco3dgltf';
await MeshoptEncoder.ready;
const io = new NodeIO().registerExtensions(ALL_EXTENSIONS).registerDependencies({
  'meshopt.encoder': MeshoptEncoder, 'meshopt.decoder': MeshoptDecoder,
  'draco3d.encoder': await draco3d.createEncoderModule(), 'draco3d.decoder': await draco3d.createDecoderModule() });

function column(doc, buffer) {
  // A column along +Y, 2 m high, that two joints bend and a morph target widens at its middle.
  const rings = 9, sides = 12, p = [], n = [], uv = [], j = [], w = [], dp = [], idx = [];
  for (let r = 0; r < rings; r++) for (let s = 0; s <= sides; s++) {
    const a = 2 * Math.PI * s / sides, y = 2 * r / (rings - 1), t = r / (rings - 1);
    p.push(0.3 * Math.cos(a), y, -0.3 * Math.sin(a)); n.push(Math.cos(a), 0, -Math.sin(a)); uv.push(s / sides, t);
    j.push(0, 1, 0, 0); w.push(1 - t, t, 0, 0);
    const k = 0.2 * Math.sin(Math.PI * t); dp.push(k * Math.cos(a), 0, -k * Math.sin(a));
    if (r + 1 < rings && s < sides) { const i = r * (sides + 1) + s, u = i + sides + 1; idx.push(i, i + 1, u, i + 1, u + 1, u); }
  }
  const acc = (type, array) => doc.createAccessor().setType(type).setArray(array).setBuffer(buffer);
  const prim = doc.createPrimitive()
    .setAttribute('POSITION', acc('VEC3', new Float32Array(p))).setAttribute('NORMAL', acc('VEC3', new Float32Array(n)))
    .setAttribute('TEXCOORD_0', acc('VEC2', new Float32Array(uv))).setAttribute('JOINTS_0', acc('VEC4', new Uint8Array(j)))
    .setAttribute('WEIGHTS_0', acc('VEC4', new Float32Array(w))).setIndices(acc('SCALAR', new Uint16Array(idx)))
    .addTarget(doc.createPrimitiveTarget('wide').setAttribute('POSITION', acc('VEC3', new Float32Array(dp))))
    .setMaterial(doc.createMaterial('blue').setBaseColorFactor([0.1, 0.2, 0.8, 1]).setMetallicFactor(0));
  return { prim, acc };
}
function make({ instanced = false, posed = true }) {
  const doc = new Document(); doc.setLogger(new Logger(Logger.Verbosity.ERROR));
  const buffer = doc.createBuffer(), scene = doc.createScene('scene');
  const { prim, acc } = column(doc, buffer);
  const mesh = doc.createMesh('column').addPrimitive(prim).setWeights([0]);
  const node = doc.createNode('column').setMesh(mesh);
  scene.addChild(node);
  if (posed) {
    node.setWeights([0.5]);
    const tip = doc.createNode('tip').setTranslation([0, 1, 0]).setRotation([0, 0, Math.sin(0.4), Math.cos(0.4)]);
    const base = doc.createNode('base').addChild(tip);
    scene.addChild(base);
    const ibm = acc('MAT4', new Float32Array([1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1,  1,0,0,0, 0,1,0,0, 0,0,1,0, 0,-1,0,1]));
    node.setSkin(doc.createSkin().addJoint(base).addJoint(tip).setInverseBindMatrices(ibm).setSkeleton(base));
  } else for (const a of ['JOINTS_0', 'WEIGHTS_0']) prim.setAttribute(a, null);
  if (instanced) {
    const ext = doc.createExtension(EXTMeshGPUInstancing).setRequired(true), t = [], q = [], s = [];
    for (let i = 0; i < 5; i++) { t.push(i, 0, -0.5 * i); q.push(0, 0, Math.sin(0.1 * i), Math.cos(0.1 * i)); s.push(1, 1 - 0.1 * i, 1); }
    node.setTranslation([0, 0.5, 0]).setExtension('EXT_mesh_gpu_instancing', ext.createInstancedMesh()
      .setAttribute('TRANSLATION', acc('VEC3', new Float32Array(t))).setAttribute('ROTATION', acc('VEC4', new Float32Array(q)))
      .setAttribute('SCALE', acc('VEC3', new Float32Array(s))));
  }
  return doc;
}
const out = process.argv[2];
await io.write(`${out}/posed.glb`, make({}));
await io.write(`${out}/rigid.glb`, make({ posed: false }));
await io.write(`${out}/instanced.glb`, make({ posed: false, instanced: true }));
let d = make({}); await d.transform(meshopt({ encoder: MeshoptEncoder, level: 'medium' })); await io.write(`${out}/posed_meshopt.glb`, d);
d = make({}); await d.transform(meshopt({ encoder: MeshoptEncoder, level: 'high' })); await io.write(`${out}/posed_meshopt_filters.glb`, d);
d = make({ posed: false }); d.createExtension(EXTMeshoptCompression).setRequired(true).setEncoderOptions({ method: 'quantize' }); await io.write(`${out}/rigid_meshopt_floats.glb`, d);
d = make({ posed: false, instanced: true }); await d.transform(meshopt({ encoder: MeshoptEncoder, level: 'high' })); await io.write(`${out}/instanced_meshopt.glb`, d);
for (const method of ['edgebreaker', 'sequential']) {
  d = make({ posed: false }); for (const t of d.getRoot().listMeshes()[0].listPrimitives()[0].listTargets()) t.dispose();
  await d.transform(draco({ method, quantizePosition: 14 })); await io.write(`${out}/rigid_draco_${method}.glb`, d);
}
d = make({}); const pr = d.getRoot().listMeshes()[0].listPrimitives()[0]; for (const t of pr.listTargets()) t.dispose();
d.getRoot().listNodes()[0].setWeights([]); d.getRoot().listMeshes()[0].setWeights([]);
await d.transform(draco({ method: 'edgebreaker' })); await io.write(`${out}/skinned_draco.glb`, d);
