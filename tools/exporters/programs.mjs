// Write the scene of two boxes: a copy of this file beside node_modules, node programs.mjs boxes.json FOLDER.
import { spawnSync } from 'node:child_process';
import { readFileSync, writeFileSync } from 'node:fs';
import { Logger, NodeIO } from '@gltf-transform/core';
import { ALL_EXTENSIONS } from '@gltf-transform/extensions';
import { draco, meshopt, palette, quantize } from '@gltf-transform/functions';
import draco3d from 'draco3dgltf';
import { MeshoptDecoder, MeshoptEncoder } from 'meshoptimizer';
import * as THREE from 'three';
import { GLTFExporter } from 'three/addons/exporters/GLTFExporter.js';

const [boxesFile, folder] = process.argv.slice(2);
const boxes = JSON.parse(readFileSync(boxesFile, 'utf8'));

// three.js, Y up. It writes binary files with this class of browsers.
globalThis.FileReader = class {
  async readAsArrayBuffer(blob) { this.result = await blob.arrayBuffer(); this.onloadend(); }
  async readAsDataURL(blob) {
    this.result = `data:application/octet-stream;base64,${Buffer.from(await blob.arrayBuffer()).toString('base64')}`;
    this.onloadend();
  }
};
const place = (mesh, { center: [x, y, z], turn }) => {
  mesh.position.set(x, z, -y);
  mesh.rotation.y = (turn * Math.PI) / 180;
  mesh.updateMatrix();
  return mesh;
};
const color = ({ color: [r, g, b] }) => new THREE.Color().setRGB(r / 255, g / 255, b / 255, THREE.SRGBColorSpace);
const shape = ({ size: [x, y, z] }) => new THREE.BoxGeometry(x, z, y);
const save = async (name, scene, options) => {
  const data = await new GLTFExporter().parseAsync(scene, options);
  writeFileSync(`${folder}/${name}`, data instanceof ArrayBuffer ? Buffer.from(data) : JSON.stringify(data));
};
const plain = new THREE.Scene();
for (const box of boxes) plain.add(place(new THREE.Mesh(shape(box), new THREE.MeshStandardMaterial({ color: color(box) })), box));
await save('three.glb', plain, { binary: true });
const instances = new THREE.Scene();
const unit = new THREE.InstancedMesh(new THREE.BoxGeometry(), new THREE.MeshStandardMaterial(), boxes.length);
boxes.forEach((box, index) => {
  const each = place(new THREE.Object3D(), box);
  each.scale.set(box.size[0], box.size[2], box.size[1]);
  each.updateMatrix();
  unit.setMatrixAt(index, each.matrix);
  unit.setColorAt(index, color(box));
});
instances.add(unit);
await save('three_instanced.glb', instances, { binary: true });
const colored = new THREE.Scene();
for (const box of boxes) {
  const geometry = shape(box);
  const rgb = color(box).toArray();
  const values = Float32Array.from({ length: 3 * geometry.attributes.position.count }, (_, index) => rgb[index % 3]);
  geometry.setAttribute('color', new THREE.BufferAttribute(values, 3));
  colored.add(place(new THREE.Mesh(geometry, new THREE.MeshStandardMaterial({ vertexColors: true })), box));
}
await save('three_vertex_colors.glb', colored, { binary: true });

// gltf-transform and gltfpack: three.js's file, made smaller.
await MeshoptEncoder.ready;
const io = new NodeIO().setLogger(new Logger(Logger.Verbosity.ERROR)).registerExtensions(ALL_EXTENSIONS).registerDependencies({
  'meshopt.encoder': MeshoptEncoder,
  'meshopt.decoder': MeshoptDecoder,
  'draco3d.encoder': await draco3d.createEncoderModule(),
});
const transforms = {
  draco: [draco()],
  meshopt: [meshopt({ encoder: MeshoptEncoder })],
  palette: [palette({ min: 1 })],
  quantize: [quantize()],
};
for (const [name, steps] of Object.entries(transforms)) {
  const document = await io.read(`${folder}/three.glb`);
  await document.transform(...steps);
  await io.write(`${folder}/gltf_transform_${name}.glb`, document);
}
const packed = { gltfpack: [], gltfpack_c: ['-c'], gltfpack_cz: ['-cz'], gltfpack_noq: ['-noq'], gltfpack_mi: ['-mi'] };
for (const [name, options] of Object.entries(packed)) {
  const source = name === 'gltfpack_mi' ? 'three_instanced.glb' : 'three.glb';
  const command = ['node_modules/gltfpack/cli.js', '-i', `${folder}/${source}`, '-o', `${folder}/${name}.glb`, ...options];
  const { status } = spawnSync('node', command, { stdio: 'inherit' });
  if (status) process.exit(status);
}
