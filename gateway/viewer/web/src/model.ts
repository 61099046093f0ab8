// The gateway's tree with world matrices; independent of WebGL and the page.

import { Matrix4, Quaternion, Vector3 } from "three";
import type { CloudLook } from "./clouds";
import type { Range } from "./colormaps";
import type { Mark } from "./marks";
import type { MeshPayload, NodeUpdate, Part, SceneUpdate } from "./protocol";

const MAX_REMEMBERED_NODES = 10_000;

export class TreeNode {
  readonly children = new Set<TreeNode>();
  parts: Part[] | null = null;
  /** Visibility in the gateway's tree. */
  visible = true;
  /** Visibility on this page, set by the eye in the tree panel; null: as in the gateway's tree. */
  shown: boolean | null = null;
  /** Opacity in the gateway's tree. */
  opacity = 1;
  /** Opacity on this page; null: as in the gateway's tree. */
  ownOpacity: number | null = null;
  /** Colours of a point cloud on this page; null: as published. */
  cloud: CloudLook | null = null;
  /** Axes and name on this page; null: none. */
  mark: Mark | null = null;
  cloudRange: Range | null = null;
  readonly local = new Matrix4();
  readonly world = new Matrix4();

  constructor(
    readonly id: number,
    readonly name: string | number,
    readonly parent: TreeNode | null,
  ) {}

  /** True if this page changed nothing of the node. */
  get isUnchanged(): boolean {
    return this.shown === null && this.ownOpacity === null && this.cloud === null && this.mark === null;
  }

  /** True if this page shows the node, unless an ancestor is hidden. */
  get isShown(): boolean {
    return this.shown ?? this.visible;
  }

  get shownOpacity(): number {
    return this.ownOpacity ?? this.opacity;
  }

  get path(): (string | number)[] {
    return this.parent ? [...this.parent.path, this.name] : [];
  }

  *subtree(): Generator<TreeNode> {
    const stack: TreeNode[] = [this];
    for (let node = stack.pop(); node; node = stack.pop()) {
      yield node;
      stack.push(...node.children);
    }
  }
}

export interface ModelChange {
  added: TreeNode[];
  removed: TreeNode[];
  /** Nodes whose geometry or visibility changed. */
  changed: Set<TreeNode>;
  /** Nodes whose world matrix changed. */
  moved: Set<TreeNode>;
}

export class Model {
  readonly root = new TreeNode(0, "", null);
  readonly nodes = new Map<number, TreeNode>([[0, this.root]]);
  readonly meshes = new Map<number, MeshPayload>();
  revision = 0;
  /** This page's settings of removed nodes by path: a node that is published again gets them back. */
  private readonly removedPageState = new Map<string, Pick<TreeNode, "shown" | "ownOpacity" | "cloud" | "mark">>();

  /** Apply an update; one from revision 0 replaces the scene. */
  apply(update: SceneUpdate): ModelChange {
    const change: ModelChange = { added: [], removed: [], changed: new Set(), moved: new Set() };
    if (update.from === 0) this.clear(change);
    for (const id of update.removed) this.remove(id, change);
    for (const entry of update.nodes) this.addOrUpdate(entry, change);
    const dirty = this.setLocalMatrices(update);
    for (const node of change.added) dirty.add(node);
    this.updateWorldMatrices(dirty, change.moved);
    this.revision = update.revision;
    return change;
  }

  private clear(change: ModelChange): void {
    for (const child of [...this.root.children]) this.remove(child.id, change);
    this.root.parts = null;
    this.root.visible = true;
    this.root.opacity = 1;
    this.root.local.identity();
    this.root.world.identity();
    change.changed.add(this.root);
  }

  private remove(id: number, change: ModelChange): void {
    const node = this.nodes.get(id);
    if (!node?.parent) return;
    node.parent.children.delete(node);
    for (const below of node.subtree()) {
      this.nodes.delete(below.id);
      const { shown, ownOpacity, cloud, mark } = below;
      if (!below.isUnchanged && this.removedPageState.size < MAX_REMEMBERED_NODES)
        this.removedPageState.set(JSON.stringify(below.path), { shown, ownOpacity, cloud, mark });
      change.removed.push(below);
    }
  }

  private addOrUpdate(entry: NodeUpdate, change: ModelChange): void {
    let node = this.nodes.get(entry.id);
    if (!node) {
      const parent = this.nodes.get(entry.parent ?? 0);
      if (!parent) throw new Error(`node ${entry.id} came before its parent ${entry.parent}`);
      node = new TreeNode(entry.id, entry.name ?? "", parent);
      parent.children.add(node);
      this.nodes.set(entry.id, node);
      change.added.push(node);
      this.restorePageState(node);
    }
    if (entry.visible !== undefined) {
      node.visible = entry.visible;
    }
    if (entry.opacity !== undefined) node.opacity = entry.opacity;
    if (entry.visible !== undefined || entry.opacity !== undefined) {
      for (const below of node.subtree()) change.changed.add(below);
    }
    if (entry.parts !== undefined) {
      node.parts = entry.parts;
      change.changed.add(node);
    }
  }

  private restorePageState(node: TreeNode): void {
    if (!this.removedPageState.size) return;
    const path = JSON.stringify(node.path);
    const state = this.removedPageState.get(path);
    if (!state) return;
    Object.assign(node, state);
    this.removedPageState.delete(path);
  }

  /** Return the node at a path. */
  find(path: (string | number)[]): TreeNode | null {
    let node: TreeNode | undefined = this.root;
    for (const name of path) node = [...(node?.children ?? [])].find((child) => child.name === name);
    return node ?? null;
  }

  private setLocalMatrices(update: SceneUpdate): Set<TreeNode> {
    const dirty = new Set<TreeNode>();
    const position = new Vector3();
    const rotation = new Quaternion();
    const unitScale = new Vector3(1, 1, 1);
    update.poseIds.forEach((id, i) => {
      const node = this.nodes.get(id);
      if (!node) return;
      const value = (k: number) => update.poses[7 * i + k] ?? 0;
      rotation.set(value(4), value(5), value(6), value(3));
      if (rotation.lengthSq() === 0) rotation.identity();
      node.local.compose(position.set(value(0), value(1), value(2)), rotation.normalize(), unitScale);
      dirty.add(node);
    });
    update.matrixIds.forEach((id, i) => {
      const node = this.nodes.get(id);
      if (!node) return;
      node.local.fromArray(update.matrices, 16 * i);
      dirty.add(node);
    });
    return dirty;
  }

  private updateWorldMatrices(dirty: Set<TreeNode>, moved: Set<TreeNode>): void {
    for (const highest of dirty) {
      let ancestor = highest.parent;
      while (ancestor && !dirty.has(ancestor)) ancestor = ancestor.parent;
      if (ancestor) continue; // moved with its ancestor
      const stack = [highest];
      for (let node = stack.pop(); node; node = stack.pop()) {
        if (node.parent) node.world.multiplyMatrices(node.parent.world, node.local);
        else node.world.copy(node.local);
        moved.add(node);
        stack.push(...node.children);
      }
    }
  }
}
