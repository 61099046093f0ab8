// The model as three.js objects: instanced batches of opaque triangles, single objects for everything else.

import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  Color,
  type Intersection,
  LineSegments,
  Matrix4,
  Mesh,
  type MeshBasicMaterial,
  Object3D,
  Points,
  Quaternion,
  Sphere,
  SRGBColorSpace,
  type Material as ThreeMaterial,
  Vector3,
} from "three";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import { Batch, type BatchInstance } from "./batches";
import { CHUNK_POINTS, type CloudProgress } from "./cloudprogress";
import { colorCloud } from "./clouds";
import type { Materials } from "./materials";
import type { Model, ModelChange, TreeNode } from "./model";
import type { Draw, MeshPayload } from "./protocol";

/** Object of a draw that is not in a batch. The first chunk of a point cloud has the others as children. */
type SingleObject = Mesh | LineSegments | LineSegments2 | Points;
/** Number of chunks of a cloud that picking searches: half a million points take 10 ms. */
const PICKED_CHUNKS = 8;
/** One draw of a node as three.js objects; `local` is its matrix in the node's frame. */
type Drawn = { local: Matrix4 | null } & ({ instance: BatchInstance } | { object: SingleObject });

export class Drawing {
  readonly root = new Object3D();
  private readonly geometries = new Map<number, BufferGeometry>();
  /** Geometries of a point cloud's chunks, by mesh id. */
  private readonly chunks = new Map<number, BufferGeometry[]>();
  /** Geometries of lines of more than one pixel, by mesh id. */
  private readonly wideLines = new Map<number, LineSegmentsGeometry>();
  /** Batches by mesh id and key of the material. */
  private readonly batches = new Map<string, Batch>();
  private readonly drawn = new Map<TreeNode, Drawn[]>();

  constructor(
    private readonly model: Model,
    readonly materials: Materials,
    private readonly progress: CloudProgress,
    /** Point of the world at which the page's scene has its origin. */
    private readonly origin: Vector3,
    private readonly redraw: () => void,
  ) {
    this.root.matrixAutoUpdate = false;
  }

  apply(change: ModelChange): void {
    for (const node of change.removed) this.erase(node);
    const recreated = new Set([...change.changed, ...change.added]);
    for (const node of recreated) if (this.model.nodes.get(node.id) === node) this.refresh(node);
    for (const node of change.moved) if (!recreated.has(node)) this.move(node);
  }

  /** Recreate a node's objects after its geometry, visibility or opacity changed. */
  refresh(node: TreeNode): void {
    const before = (this.drawn.get(node) ?? []).map((drawn) => ("instance" in drawn ? drawn.instance.batch : drawn.object).material);
    this.erase(node);
    if (!node.parts || !visible(node)) return;
    const opacity = combinedOpacity(node);
    const draws: Drawn[] = [];
    for (const part of node.parts)
      for (const draw of part.draws) {
        this.materials.replaced = (before[draws.length] as MeshBasicMaterial | undefined)?.map ?? null;
        const drawn = this.draw(node, draw, opacity, part.facesCamera === true);
        if (drawn) draws.push(drawn);
      }
    this.materials.replaced = null;
    if (draws.length) this.drawn.set(node, draws);
  }

  forget(meshes: Iterable<number>): void {
    const ids = new Set(meshes);
    for (const batch of this.batches.values()) if (ids.has(batch.meshId)) this.drop(batch);
    for (const id of ids) {
      this.geometries.get(id)?.dispose();
      this.geometries.delete(id);
      for (const chunk of this.chunks.get(id) ?? []) chunk.dispose();
      this.chunks.delete(id);
      this.wideLines.get(id)?.dispose();
      this.wideLines.delete(id);
      this.model.meshes.delete(id);
    }
  }

  /** Remove everything: another gateway uses other ids. */
  reset(): void {
    for (const node of [...this.drawn.keys()]) this.erase(node);
    this.forget([...this.model.meshes.keys()]);
    this.materials.forgetTextures();
  }

  /** Place everything again, after the origin moved. */
  moveAll(): void {
    for (const node of this.drawn.keys()) this.move(node);
  }

  /** Return the bounds of a subtree in the page's scene; empty if nothing is drawn. */
  bounds(node: TreeNode): Box3 {
    return this.boxes(node).reduce((all, box) => all.union(box), new Box3());
  }

  /** Return the bounds of each draw but floors and walls much larger than the rest, as gateway/scene/bounds.py does. */
  focusBoxes(node: TreeNode): Box3[] {
    const size = (box: Box3) => box.getSize(new Vector3()).toArray();
    const flat = (box: Box3) => Math.min(...size(box)) < 0.01 * Math.max(...size(box));
    const boxes = this.boxes(node);
    const solid = boxes.filter((box) => !flat(box)).reduce((all, box) => all.union(box), new Box3());
    if (solid.isEmpty()) return boxes;
    const longestFlat = 1.5 * solid.getSize(new Vector3()).length();
    return boxes.filter((box) => !flat(box) || Math.max(...size(box)) <= longestFlat);
  }

  nodeAt(hit: Intersection): TreeNode | undefined {
    const batch = hit.object.userData.batch as Batch | undefined;
    if (batch && hit.instanceId !== undefined) return batch.instances[hit.instanceId]?.node;
    return hit.object.userData.node as TreeNode | undefined;
  }

  /** Return the bounds of each draw of a subtree. */
  boxes(node: TreeNode): Box3[] {
    const boxes: Box3[] = [];
    for (const each of node.subtree())
      for (const drawn of this.drawn.get(each) ?? []) {
        const geometry = "instance" in drawn ? drawn.instance.batch.geometry : drawn.object.geometry;
        if (!geometry.boundingBox) geometry.computeBoundingBox();
        const box = geometry.boundingBox?.clone().applyMatrix4(this.place(each, drawn.local));
        if (box && !box.isEmpty() && Number.isFinite(box.min.lengthSq() + box.max.lengthSq())) boxes.push(box);
      }
    return boxes;
  }

  private draw(node: TreeNode, draw: Draw, opacity: number, facesCamera: boolean): Drawn | null {
    const payload = this.model.meshes.get(draw.mesh);
    if (!payload || draw.matrix === null) return null;
    const local = draw.matrix ? new Matrix4().fromArray(draw.matrix) : null;
    const place = this.place(node, local);
    const hasColors = payload.color !== undefined;
    const { material } = draw;
    const blended = material.alpha === "blend" && (material.color[3] < 1 || material.texture !== undefined || hasColors);
    if (payload.topology === 3 && opacity === 1 && !blended && !facesCamera)
      return {
        local,
        instance: this.batch(draw, this.geometry(payload), hasColors).add(node, place, new Color(...material.color.slice(0, 3))),
      };
    let object: SingleObject;
    if (payload.topology === 3) object = new Mesh(this.geometry(payload), this.materials.translucent(material, hasColors, opacity));
    else if (payload.topology === 2 && (material.lineWidth ?? 1) > 1)
      object = new LineSegments2(this.wideLine(payload), this.materials.wideLine(material, hasColors, opacity));
    else if (payload.topology === 2) object = new LineSegments(this.geometry(payload), this.materials.line(material, hasColors, opacity));
    else object = this.points(node, draw, payload, opacity);
    if (object instanceof Mesh) object.receiveShadow = true;
    object.matrixAutoUpdate = false;
    object.matrix.copy(place);
    object.matrixWorldNeedsUpdate = true;
    object.userData.node = node;
    if (facesCamera) object.onBeforeRender = (_renderer, _scene, camera) => turnToCamera(object, camera);
    this.root.add(object);
    return { local, object };
  }

  /** Return the matrix of a draw in the page's scene, in double precision: the GPU gets it in single precision. */
  private place(node: TreeNode, local: Matrix4 | null): Matrix4 {
    const matrix = node.world.clone();
    if (local) matrix.multiply(local);
    const { elements } = matrix;
    elements[12] -= this.origin.x;
    elements[13] -= this.origin.y;
    elements[14] -= this.origin.z;
    return matrix;
  }

  private batch(draw: Draw, geometry: BufferGeometry, hasColors: boolean): Batch {
    const key = `${draw.mesh} ${this.materials.key(draw.material, hasColors)}`;
    let batch = this.batches.get(key);
    if (!batch) this.batches.set(key, (batch = new Batch(this.root, draw.mesh, key, geometry, this.materials.opaque(draw.material, hasColors))));
    return batch;
  }

  /** Dispose of a batch, unless `forget` did. */
  private drop(batch: Batch): void {
    if (!this.batches.delete(batch.key)) return;
    batch.dispose();
    this.materials.release(batch.material);
  }

  private points(node: TreeNode, draw: Draw, payload: MeshPayload, opacity: number): Points {
    const material = this.materials.points(draw.material, payload.color !== undefined, opacity);
    const objects = this.chunkGeometries(payload).map((geometry) => new Points(geometry, material));
    const [first, ...others] = objects as [Points, ...Points[]];
    objects.forEach((object, number) => {
      if (others.length) this.progress.add(object, number);
      if (number >= PICKED_CHUNKS) object.raycast = () => {};
      object.userData.node = node;
    });
    if (others.length) first.add(...others);
    if (node.cloud) void this.colorPoints(node, draw, objects, payload, opacity);
    return first;
  }

  /** Replace the colours of a cloud by those that the details panel has chosen for its node. */
  private async colorPoints(node: TreeNode, draw: Draw, objects: Points[], payload: MeshPayload, opacity: number): Promise<void> {
    if (!node.cloud) return;
    const colored = await colorCloud(payload, node.cloud);
    const [first] = objects;
    if (!colored || !first?.parent) return;
    node.cloudRange = colored.range;
    const white = { ...draw.material, color: [1, 1, 1, draw.material.color[3]] as [number, number, number, number] };
    this.materials.release(first.material as ThreeMaterial);
    const material = this.materials.points(white, true, opacity);
    objects.forEach((object, number) => {
      object.geometry = object.userData.ownGeometry = object.geometry.clone();
      object.geometry.setAttribute("color", new BufferAttribute(chunkOf(colored.colors, 4, number), 4, true));
      object.material = material;
    });
    this.redraw();
  }

  private move(node: TreeNode): void {
    for (const drawn of this.drawn.get(node) ?? []) {
      const place = this.place(node, drawn.local);
      if ("instance" in drawn) drawn.instance.batch.move(drawn.instance, place);
      else {
        drawn.object.matrix.copy(place);
        drawn.object.matrixWorldNeedsUpdate = true;
      }
    }
  }

  private erase(node: TreeNode): void {
    for (const drawn of this.drawn.get(node) ?? []) {
      if ("instance" in drawn) {
        const { batch } = drawn.instance;
        batch.remove(drawn.instance);
        if (!batch.instances.length) this.drop(batch);
        continue;
      }
      this.root.remove(drawn.object);
      this.materials.release(drawn.object.material as ThreeMaterial);
      const objects = [drawn.object, ...drawn.object.children];
      for (const object of objects) (object.userData.ownGeometry as BufferGeometry | undefined)?.dispose();
      if (objects.length > 1) this.progress.remove(new Set(objects));
    }
    this.drawn.delete(node);
  }

  private wideLine(payload: MeshPayload): LineSegmentsGeometry {
    let geometry = this.wideLines.get(payload.id);
    if (geometry) return geometry;
    const index = payload.index ?? Uint32Array.from({ length: payload.position.length / 3 }, (_, i) => i);
    geometry = new LineSegmentsGeometry();
    geometry.setPositions(Float32Array.from({ length: 3 * index.length }, (_, i) => payload.position[3 * index[Math.floor(i / 3)]! + (i % 3)]!));
    const { color } = payload;
    if (color) geometry.setColors(linearColors(color, index));
    this.wideLines.set(payload.id, geometry);
    return geometry;
  }

  /** Return the geometries of a cloud's chunks; a cloud with an index is one chunk. */
  private chunkGeometries(payload: MeshPayload): BufferGeometry[] {
    const count = payload.position.length / 3;
    if (payload.index || count <= CHUNK_POINTS) return [this.geometry(payload)];
    let geometries = this.chunks.get(payload.id);
    if (!geometries) {
      const { position, color } = payload;
      geometries = Array.from({ length: Math.ceil(count / CHUNK_POINTS) }, (_, number) => {
        const geometry = new BufferGeometry();
        geometry.setAttribute("position", new BufferAttribute(chunkOf(position, 3, number), 3));
        if (color) geometry.setAttribute("color", new BufferAttribute(chunkOf(color, 4, number), 4, true));
        setBounds(geometry, payload);
        return geometry;
      });
      this.chunks.set(payload.id, geometries);
    }
    return geometries;
  }

  private geometry(payload: MeshPayload): BufferGeometry {
    let geometry = this.geometries.get(payload.id);
    if (geometry) return geometry;
    geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(payload.position, 3));
    if (payload.normal) geometry.setAttribute("normal", new BufferAttribute(payload.normal, 3));
    if (payload.color) geometry.setAttribute("color", new BufferAttribute(payload.color, 4, true));
    if (payload.uv) geometry.setAttribute("uv", new BufferAttribute(payload.uv, 2));
    if (payload.uv1) geometry.setAttribute("uv1", new BufferAttribute(payload.uv1, 2));
    if (payload.index) geometry.setIndex(new BufferAttribute(payload.index, 1));
    if (payload.topology === 3 && !payload.normal) {
      if (payload.index) geometry = geometry.toNonIndexed(); // flat: triangles share no vertices
      geometry.computeVertexNormals();
    }
    setBounds(geometry, payload);
    this.geometries.set(payload.id, geometry);
    return geometry;
  }
}

/** Turn an object about its origin so that its x and y axes are those of the camera. Position and scale stay. */
function turnToCamera(object: Object3D, camera: Object3D): void {
  const position = new Vector3().setFromMatrixPosition(object.matrixWorld);
  const scale = new Vector3().setFromMatrixScale(object.matrixWorld);
  object.matrixWorld.compose(position, camera.getWorldQuaternion(new Quaternion()), scale);
}

/** Set the bounds that the gateway sent: computing them takes a tenth of a second for millions of points. */
function setBounds(geometry: BufferGeometry, { box }: MeshPayload): void {
  if (!box) return;
  geometry.boundingBox = new Box3(new Vector3(...box[0]), new Vector3(...box[1]));
  geometry.boundingSphere = geometry.boundingBox.getBoundingSphere(new Sphere());
}

/** Return a chunk's part of an array with `width` numbers for each point of the cloud. */
function chunkOf<A extends Float32Array | Uint8Array>(array: A, width: number, number: number): A {
  return array.subarray(width * number * CHUNK_POINTS, width * (number + 1) * CHUNK_POINTS) as A;
}

/** Return the linear colours of a wide line's vertices: the shader of LineMaterial does not convert them from sRGB. */
function linearColors(color: Uint8Array, index: Uint32Array): Float32Array {
  const linear = new Float32Array(3 * index.length);
  const value = new Color();
  index.forEach((vertex, i) => {
    value.setRGB(color[4 * vertex]! / 255, color[4 * vertex + 1]! / 255, color[4 * vertex + 2]! / 255, SRGBColorSpace);
    value.toArray(linear, 3 * i);
  });
  return linear;
}

function visible(node: TreeNode): boolean {
  for (let ancestor: TreeNode | null = node; ancestor; ancestor = ancestor.parent) if (!ancestor.isShown) return false;
  return true;
}

function combinedOpacity(node: TreeNode): number {
  let opacity = 1;
  for (let ancestor: TreeNode | null = node; ancestor; ancestor = ancestor.parent) opacity *= ancestor.shownOpacity;
  return opacity;
}
