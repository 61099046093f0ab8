// Instanced drawing of opaque triangles: draws with the same mesh and material are one call, each with its own colour.

import { type BufferGeometry, Color, DynamicDrawUsage, InstancedBufferAttribute, InstancedMesh, type Material, type Matrix4 } from "three";
import type { TreeNode } from "../model";

/** One instance in a batch. */
export interface BatchInstance {
  index: number;
  node: TreeNode;
}

const INITIAL_CAPACITY = 8;

export class Batch extends InstancedMesh<BufferGeometry, Material> {
  readonly instances: BatchInstance[] = [];

  constructor(
    readonly meshId: number,
    readonly key: string,
    geometry: BufferGeometry,
    material: Material,
    castsShadow: boolean,
  ) {
    super(geometry, material, INITIAL_CAPACITY);
    this.instanceMatrix.setUsage(DynamicDrawUsage);
    this.setColorAt(0, new Color(1, 1, 1)); // creates the attribute
    this.count = 0;
    this.frustumCulled = false; // otherwise every pose would need new bounds
    this.matrixAutoUpdate = false;
    this.castShadow = castsShadow;
    this.receiveShadow = true;
  }

  append(node: TreeNode, matrix: Matrix4, color: Color): BatchInstance {
    if (this.count === this.instanceMatrix.count) this.grow();
    const instance = { index: this.count, node };
    this.count = this.instances.push(instance);
    this.setMatrixAt(instance.index, matrix);
    this.setColorAt(instance.index, color);
    this.markChanged();
    return instance;
  }

  move(instance: BatchInstance, matrix: Matrix4): void {
    this.setMatrixAt(instance.index, matrix);
    this.instanceMatrix.needsUpdate = true;
    this.boundingSphere = null;
  }

  take(instance: BatchInstance): void {
    const last = this.instances.pop()!;
    if (last !== instance) {
      for (const each of [this.instanceMatrix, this.instanceColor!]) each.copyAt(instance.index, each, last.index);
      this.instances[instance.index] = last;
      last.index = instance.index;
    }
    this.count = this.instances.length;
    this.markChanged();
  }

  private grow(): void {
    this.dispose(); // of the buffers on the GPU
    for (const name of ["instanceMatrix", "instanceColor"] as const) {
      const { array, itemSize, usage } = this[name]!;
      this[name] = new InstancedBufferAttribute(new Float32Array(2 * array.length), itemSize).setUsage(usage).copyArray(array);
    }
  }

  private markChanged(): void {
    this.instanceMatrix.needsUpdate = this.instanceColor!.needsUpdate = true;
    this.boundingSphere = null;
  }
}
