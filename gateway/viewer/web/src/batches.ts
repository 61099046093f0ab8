// Instanced drawing of opaque triangles: draws with the same mesh and material are one call, each with its own colour.

import { Color, DynamicDrawUsage, InstancedMesh, Matrix4, Object3D, type BufferGeometry, type Material } from "three";
import type { TreeNode } from "./model";

/** One instance in a batch. */
export interface Slot {
  batch: Batch;
  index: number;
  node: TreeNode;
}

const FIRST_CAPACITY = 8;

export class Batch {
  readonly slots: Slot[] = [];
  private mesh: InstancedMesh;

  constructor(
    private readonly scene: Object3D,
    readonly geometry: BufferGeometry,
    readonly material: Material,
  ) {
    this.mesh = this.allocate(FIRST_CAPACITY);
  }

  private allocate(capacity: number): InstancedMesh {
    const mesh = new InstancedMesh(this.geometry, this.material, capacity);
    mesh.instanceMatrix.setUsage(DynamicDrawUsage);
    mesh.setColorAt(0, new Color(1, 1, 1)); // creates the attribute
    mesh.count = 0;
    mesh.frustumCulled = false; // else its bounds had to be updated with every pose
    mesh.matrixAutoUpdate = false;
    mesh.userData.batch = this;
    this.scene.add(mesh);
    return mesh;
  }

  get object(): InstancedMesh {
    return this.mesh;
  }

  add(node: TreeNode, matrix: Matrix4, color: Color): Slot {
    if (this.slots.length === this.mesh.instanceMatrix.count) this.grow();
    const slot: Slot = { batch: this, index: this.slots.length, node };
    this.slots.push(slot);
    this.mesh.count = this.slots.length;
    this.mesh.setMatrixAt(slot.index, matrix);
    this.mesh.setColorAt(slot.index, color);
    this.touch();
    return slot;
  }

  move(slot: Slot, matrix: Matrix4): void {
    this.mesh.setMatrixAt(slot.index, matrix);
    this.mesh.instanceMatrix.needsUpdate = true;
    this.mesh.boundingSphere = null;
  }

  remove(slot: Slot): void {
    const last = this.slots.pop();
    if (last && last !== slot) {
      const matrix = new Matrix4();
      const color = new Color();
      this.mesh.getMatrixAt(last.index, matrix);
      this.mesh.getColorAt(last.index, color);
      this.mesh.setMatrixAt(slot.index, matrix);
      this.mesh.setColorAt(slot.index, color);
      this.slots[slot.index] = last;
      last.index = slot.index;
    }
    this.mesh.count = this.slots.length;
    this.touch();
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

  private touch(): void {
    this.mesh.instanceMatrix.needsUpdate = true;
    if (this.mesh.instanceColor) this.mesh.instanceColor.needsUpdate = true;
    this.mesh.boundingSphere = null;
  }
}
