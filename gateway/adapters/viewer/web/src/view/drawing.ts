// The model as three.js objects: instanced batches of opaque triangles, single objects for everything else.

import { Box3, type BufferGeometry, Color, type Intersection, Matrix4, type MeshBasicMaterial, Object3D, Vector3 } from "three";
import type { Model, ModelChange, TreeNode } from "../model";
import type { Draw } from "../protocol";
import { Batch, type BatchInstance } from "./batches";
import { Geometries } from "./geometries";
import { type SingleObject, SingleObjects } from "./singleobjects";
import type { Stage } from "./stage";

/** One draw of a node: an instance in a batch, or an object of its own. `local` is its matrix in the node's frame. */
type Drawn = { local: Matrix4 | null } & ({ object: Batch; instance: BatchInstance } | { object: SingleObject; instance?: undefined });

export class Drawing {
  readonly root = new Object3D();
  private readonly geometries = new Geometries();
  private readonly singles: SingleObjects;
  /** Batches by mesh id and key of the material. */
  private readonly batches = new Map<string, Batch>();
  private readonly drawn = new Map<TreeNode, Drawn[]>();

  constructor(
    private readonly model: Model,
    private readonly stage: Stage,
  ) {
    this.singles = new SingleObjects(this.geometries, stage);
    this.root.matrixAutoUpdate = false;
    stage.content.add(this.root);
  }

  apply(change: ModelChange): void {
    for (const node of change.removed) this.erase(node);
    const recreated = new Set([...change.changed, ...change.added]);
    for (const node of recreated) if (this.model.nodes.get(node.id) === node) this.refresh(node);
    for (const node of change.moved) if (!recreated.has(node)) this.move(node);
  }

  /** Recreate a node's objects after its geometry, visibility or opacity changed. */
  refresh(node: TreeNode): void {
    const { textures } = this.stage.materials;
    const before = (this.drawn.get(node) ?? []).map(({ object }) => object.material);
    this.erase(node);
    if (!node.parts || !node.isVisible) return;
    const draws: Drawn[] = [];
    for (const part of node.parts)
      for (const draw of part.draws) {
        textures.replaced = (before[draws.length] as MeshBasicMaterial | undefined)?.map ?? null;
        const drawn = this.draw(node, draw, part.facesCamera === true);
        if (drawn) draws.push(drawn);
      }
    textures.replaced = null;
    if (draws.length) this.drawn.set(node, draws);
  }

  forget(meshes: Iterable<number>): void {
    const ids = new Set(meshes);
    for (const batch of this.batches.values()) if (ids.has(batch.meshId)) this.drop(batch);
    for (const id of ids) {
      this.geometries.dispose(id);
      this.model.meshes.delete(id);
    }
  }

  /** Remove everything: another gateway uses other ids. */
  reset(): void {
    for (const node of [...this.drawn.keys()]) this.erase(node);
    this.forget([...this.model.meshes.keys()]);
    this.stage.materials.forget();
  }

  /** Place everything again, after the origin moved. */
  moveAll(): void {
    for (const node of this.drawn.keys()) this.move(node);
  }

  /** Return the bounds of a subtree in the page's scene; empty if nothing is drawn. */
  bounds(node: TreeNode): Box3 {
    return union(this.boxes(node));
  }

  /** Return the bounds of each draw but floors and walls much larger than the rest, as gateway/scene/draw/bounds.py does. */
  focusBoxes(node: TreeNode): Box3[] {
    const size = (box: Box3) => box.getSize(new Vector3()).toArray();
    const flat = (box: Box3) => Math.min(...size(box)) < 0.01 * Math.max(...size(box));
    const boxes = this.boxes(node);
    const solid = union(boxes.filter((box) => !flat(box)));
    if (solid.isEmpty()) return boxes;
    const longestFlat = 1.5 * solid.getSize(new Vector3()).length();
    return boxes.filter((box) => !flat(box) || Math.max(...size(box)) <= longestFlat);
  }

  nodeAt(hit: Intersection): TreeNode | undefined {
    return hit.object instanceof Batch ? hit.object.instances[hit.instanceId!]?.node : hit.object.userData.node;
  }

  /** Return the bounds of each draw of a subtree. */
  boxes(node: TreeNode): Box3[] {
    const boxes: Box3[] = [];
    for (const each of node.subtree())
      for (const { object, local } of this.drawn.get(each) ?? []) {
        const { geometry } = object;
        if (!geometry.boundingBox) geometry.computeBoundingBox();
        const box = geometry.boundingBox?.clone().applyMatrix4(this.place(each, local));
        if (box && !box.isEmpty() && Number.isFinite(box.min.lengthSq() + box.max.lengthSq())) boxes.push(box);
      }
    return boxes;
  }

  private draw(node: TreeNode, draw: Draw, facesCamera: boolean): Drawn | null {
    const payload = this.model.meshes.get(draw.mesh);
    if (!payload || draw.matrix === null) return null;
    const local = draw.matrix ? new Matrix4().fromArray(draw.matrix) : null;
    const place = this.place(node, local);
    const hasColors = payload.color !== undefined;
    const { material } = draw;
    const blended = material.alpha === "blend" && (material.color[3] < 1 || material.texture !== undefined || hasColors);
    if (payload.topology === 3 && node.combinedOpacity === 1 && !blended && !facesCamera) {
      const batch = this.batch(draw, this.geometries.whole(payload), hasColors);
      return { local, object: batch, instance: batch.append(node, place, new Color(...material.color.slice(0, 3))) };
    }
    const object = this.singles.make(node, draw, payload, facesCamera);
    placeAt(object, place);
    this.root.add(object);
    return { local, object };
  }

  /** Return the matrix of a draw in the page's scene, in double precision: the GPU gets it in single precision. */
  private place(node: TreeNode, local: Matrix4 | null): Matrix4 {
    const matrix = node.world.clone();
    if (local) matrix.multiply(local);
    const { elements } = matrix;
    const { origin } = this.stage.rig;
    elements[12] -= origin.x;
    elements[13] -= origin.y;
    elements[14] -= origin.z;
    return matrix;
  }

  private batch(draw: Draw, geometry: BufferGeometry, hasColors: boolean): Batch {
    const key = `${draw.mesh} ${this.stage.materials.key(draw.material, hasColors)}`;
    let batch = this.batches.get(key);
    if (!batch) {
      const material = this.stage.materials.acquire("opaque", draw.material, hasColors);
      batch = new Batch(draw.mesh, key, geometry, material, draw.material.castsShadow !== false);
      this.batches.set(key, batch);
      this.root.add(batch);
    }
    return batch;
  }

  /** Dispose of a batch, unless `forget` did. */
  private drop(batch: Batch): void {
    if (!this.batches.delete(batch.key)) return;
    batch.removeFromParent();
    batch.dispose();
    this.stage.materials.release(batch.material);
  }

  private move(node: TreeNode): void {
    for (const { object, instance, local } of this.drawn.get(node) ?? []) {
      if (instance) object.move(instance, this.place(node, local));
      else placeAt(object, this.place(node, local));
    }
  }

  private erase(node: TreeNode): void {
    for (const { object, instance } of this.drawn.get(node) ?? []) {
      if (instance) object.take(instance);
      else this.singles.remove(object);
      if (instance && !object.count) this.drop(object);
    }
    this.drawn.delete(node);
  }
}

function union(boxes: Box3[]): Box3 {
  return boxes.reduce((all, box) => all.union(box), new Box3());
}

function placeAt(object: Object3D, place: Matrix4): void {
  object.matrix.copy(place);
  object.matrixWorldNeedsUpdate = true;
}
