// The gateway's tree with world matrices; independent of WebGL and the page.

import { Matrix4, Quaternion, Vector3 } from "three";
import type { MeshPayload, NodeUpdate, PagePart, Path, SceneUpdate } from "./protocol";

const MAX_REMEMBERED_NODES = 10_000;
/** Bytes of meshes that no node uses: the gateway has those of its history, too. */
const MAX_UNUSED_BYTES = 64 << 20;

/** What the view shows of a node over the scene. */
export interface Mark {
  axes: boolean;
  name: boolean;
  /** True: also of all nodes below it. */
  below: boolean;
}

export type MapName = "turbo" | "viridis" | "grey" | "blue–red";
/** Colours of a point cloud that this page has chosen. */
export interface CloudLook {
  /** Source of the colours: "" as published, "x", "y", "z" in the cloud's frame, or a channel as "name" or "name:component". */
  by: string;
  map: MapName;
}
export type Range = { low: number; high: number };

/** Frame in which poses are shown; a path is that of a node. */
export type Frame = "world" | "parent" | Path;

/** A node as it is published, and what this page shows otherwise: `shown`, `ownOpacity`, `cloud`, `mark`; null: as published. */
export class TreeNode {
  readonly children = new Set<TreeNode>();
  parts: PagePart[] | null = null;
  visible = true;
  shown: boolean | null = null;
  opacity = 1;
  ownOpacity: number | null = null;
  cloud: CloudLook | null = null;
  cloudRange: Range | null = null;
  mark: Mark | null = null;
  readonly local = new Matrix4();
  readonly world = new Matrix4();

  constructor(
    readonly id: number,
    readonly name: string | number,
    readonly parent: TreeNode | null,
  ) {}

  /** True if this page shows the node, unless an ancestor is hidden. */
  get isShown(): boolean {
    return this.shown ?? this.visible;
  }

  /** True if this page shows the node and all of its ancestors. */
  get isVisible(): boolean {
    return this.isShown && (this.parent?.isVisible ?? true);
  }

  get shownOpacity(): number {
    return this.ownOpacity ?? this.opacity;
  }

  /** Opacity of the node times that of its ancestors. */
  get combinedOpacity(): number {
    return this.shownOpacity * (this.parent?.combinedOpacity ?? 1);
  }

  /** Name as it is shown. */
  get shownName(): string {
    return this.parent ? String(this.name) || '""' : "scene";
  }

  get path(): Path {
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
  /** Bytes of meshes from which unused ones are dropped. */
  private maxMeshBytes = MAX_UNUSED_BYTES;
  /** This page's settings of removed nodes by path: a node that is published again gets them back. */
  private readonly removedPageState = new Map<string, Partial<TreeNode>>();

  /** Apply an update; one from revision 0 replaces the scene. */
  apply(update: SceneUpdate): ModelChange {
    const change: ModelChange = { added: [], removed: [], changed: new Set(), moved: new Set() };
    if (update.from === 0) this.clear(change);
    for (const id of update.removed ?? []) this.remove(id, change);
    for (const entry of update.nodes ?? []) this.addOrUpdate(entry, change);
    const dirty = this.setLocalMatrices(update);
    for (const node of change.added) dirty.add(node);
    this.updateWorldMatrices(dirty, change.moved);
    this.revision = update.revision;
    return change;
  }

  private clear(change: ModelChange): void {
    for (const child of [...this.root.children]) this.remove(child.id, change);
    Object.assign(this.root, { parts: null, visible: true, opacity: 1 });
    for (const matrix of [this.root.local, this.root.world]) matrix.identity();
    change.changed.add(this.root);
  }

  private remove(id: number, change: ModelChange): void {
    const node = this.nodes.get(id);
    if (!node?.parent) return;
    node.parent.children.delete(node);
    for (const below of node.subtree()) {
      this.nodes.delete(below.id);
      const { shown, ownOpacity, cloud, mark } = below;
      const isChanged = [shown, ownOpacity, cloud, mark].some((value) => value !== null);
      if (isChanged && this.removedPageState.size < MAX_REMEMBERED_NODES)
        this.removedPageState.set(JSON.stringify(below.path), { shown, ownOpacity, cloud, mark });
      change.removed.push(below);
    }
  }

  private addOrUpdate(entry: NodeUpdate, change: ModelChange): void {
    const { id, parts } = entry;
    const node = this.nodes.get(id) ?? this.add(entry, change);
    const { visible = node.visible, opacity = node.opacity } = entry;
    if (visible !== node.visible || opacity !== node.opacity) for (const below of node.subtree()) change.changed.add(below);
    Object.assign(node, { visible, opacity });
    if (parts === undefined) return;
    node.parts = parts;
    change.changed.add(node);
  }

  private add({ id, parent = 0, name = "" }: NodeUpdate, change: ModelChange): TreeNode {
    const above = this.nodes.get(parent);
    if (!above) throw new Error(`node ${id} came before its parent ${parent}`);
    const node = new TreeNode(id, name, above);
    above.children.add(node);
    this.nodes.set(id, node);
    change.added.push(node);
    if (this.removedPageState.size) {
      const path = JSON.stringify(node.path);
      Object.assign(node, this.removedPageState.get(path));
      this.removedPageState.delete(path);
    }
    return node;
  }

  /** Return the ids of meshes that no node uses, if they are too large together. */
  unusedMeshes(): number[] {
    const sizes = new Map([...this.meshes].map(([id, mesh]) => [id, bytesOf(mesh)]));
    const total = (ids: Iterable<number>) => [...ids].reduce((sum, id) => sum + (sizes.get(id) ?? 0), 0);
    if (total(sizes.keys()) <= this.maxMeshBytes) return [];
    const used = new Set([...this.nodes.values()].flatMap(({ parts }) => parts ?? []).flatMap(({ draws }) => draws.map(({ mesh }) => mesh)));
    this.maxMeshBytes = total(used) + MAX_UNUSED_BYTES;
    return [...sizes.keys()].filter((id) => !used.has(id));
  }

  find(path: Path): TreeNode | null {
    let node: TreeNode | undefined = this.root;
    for (const name of path) node = [...(node?.children ?? [])].find((child) => child.name === name);
    return node ?? null;
  }

  private setLocalMatrices({ poses, matrices }: SceneUpdate): Set<TreeNode> {
    const dirty = new Set<TreeNode>();
    const [position, rotation, unitScale] = [new Vector3(), new Quaternion(), new Vector3(1, 1, 1)];
    const find = (id: number) => {
      const node = this.nodes.get(id);
      if (node) dirty.add(node);
      return node?.local;
    };
    poses?.ids.forEach((id, i) => {
      const { values } = poses;
      const at = 7 * i;
      rotation.set(values[at + 4]!, values[at + 5]!, values[at + 6]!, values[at + 3]!);
      if (rotation.lengthSq() === 0) rotation.identity();
      find(id)?.compose(position.fromArray(values, at), rotation.normalize(), unitScale);
    });
    matrices?.ids.forEach((id, i) => void find(id)?.fromArray(matrices.values, 16 * i));
    return dirty;
  }

  private updateWorldMatrices(dirty: Set<TreeNode>, moved: Set<TreeNode>): void {
    for (const highest of dirty) {
      let ancestor = highest.parent;
      while (ancestor && !dirty.has(ancestor)) ancestor = ancestor.parent;
      if (ancestor) continue; // moved with its ancestor
      for (const node of highest.subtree()) {
        if (node.parent) node.world.multiplyMatrices(node.parent.world, node.local);
        else node.world.copy(node.local);
        moved.add(node);
      }
    }
  }
}

function bytesOf(mesh: MeshPayload): number {
  return Object.values(mesh).reduce((sum, value) => sum + (ArrayBuffer.isView(value) ? value.byteLength : 0), 0);
}
