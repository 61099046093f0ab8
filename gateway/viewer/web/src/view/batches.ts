// Instanced drawing of opaque triangles: draws with the same mesh and material are one call, each with its own colour.

import { type BufferGeometry, Color, DynamicDrawUsage, InstancedMesh, type Material, type Matrix4, type Object3D } from "three";
import type { TreeNode } from "../model";

/** One instance in a batch. */
export interface BatchInstance {
  batch: Batch;
  index: number;
  node: TreeNode;
}

const INITIAL_CAPACITY = 8;

export class Batch {
  readonly instances: BatchInstance[] = [];
  private mesh: InstancedMesh;

  constructor(
    private readonly scene: Object3D,
    readonly meshId: number,
    readonly key: string,
    readonly geometry: BufferGeometry,
    readonly material: Material,
  ) {
    this.mesh = this.allocate(INITIAL_CAPACITY);
  }

  private allocate(capacity: number): InstancedMesh {
    const mesh = new InstancedMesh(this.geometry, this.material, capacity);
    mesh.instanceMatrix.setUsage(DynamicDrawUsage);
    mesh.setColorAt(0, new Color(1, 1, 1)); // creates the attribute
    mesh.count = 0;
    mesh.frustumCulled = false; // otherwise every pose would need new bounds
    mesh.matrixAutoUpdate = false;
    mesh.castShadow = mesh.receiveShadow = true;
    mesh.userData.batch = this;
    this.scene.add(mesh);
    return mesh;
  }

  add(node: TreeNode, matrix: Matrix4, color: Color): BatchInstance {
    if (this.instances.length === this.mesh.instanceMatrix.count) this.grow();
    const instance: BatchInstance = { batch: this, index: this.instances.length, node };
    this.instances.push(instance);
    this.mesh.count = this.instances.length;
    this.mesh.setMatrixAt(instance.index, matrix);
    this.mesh.setColorAt(instance.index, color);
    this.markChanged();
    return instance;
  }

  move(instance: BatchInstance, matrix: Matrix4): void {
    this.mesh.setMatrixAt(instance.index, matrix);
    this.mesh.instanceMatrix.needsUpdate = true;
    this.mesh.boundingSphere = null;
  }

  remove(instance: BatchInstance): void {
    const last = this.instances.pop();
    if (last && last !== instance) {
      const { instanceMatrix, instanceColor } = this.mesh;
      for (const each of [instanceMatrix, instanceColor]) each?.copyAt(instance.index, each, last.index);
      this.instances[instance.index] = last;
      last.index = instance.index;
    }
    this.mesh.count = this.instances.length;
    this.markChanged();
  }

  dispose(): void {
    this.scene.remove(this.mesh);
    this.mesh.dispose();
  }

  private grow(): void {
    const old = this.mesh;
    this.mesh = this.allocate(2 * old.instanceMatrix.count);
    this.mesh.instanceMatrix.array.set(old.instanceMatrix.array);
    if (old.instanceColor) this.mesh.instanceColor?.array.set(old.instanceColor.array);
    this.scene.remove(old);
    old.dispose();
  }

  private markChanged(): void {
    this.mesh.instanceMatrix.needsUpdate = true;
    if (this.mesh.instanceColor) this.mesh.instanceColor.needsUpdate = true;
    this.mesh.boundingSphere = null;
  }
}
