// What the views of the page show: the scene, the selection, the connection and the gateway's state. Without a browser.

import { batch, computed, signal } from "@preact/signals";
import { type Frame, Model, type ModelChange, type TreeNode } from "./model";
import type { Path, SceneUpdate, Status } from "./protocol";

export type ConnectionState = "connecting" | "open" | "closed";

export class Session {
  readonly model = new Model();
  readonly selected = signal<TreeNode | null>(null);
  /** Path of a selected node that was removed: it is selected again when it is published. */
  readonly awaited = signal<Path | null>(null);
  /** Point of the world that was clicked to select the node; null: it was selected otherwise. */
  readonly clicked = signal<[number, number, number] | null>(null);
  /** Frame of the pose in the details panel. */
  readonly frame = signal<Frame>("world");
  /** Node to which the tree opens and scrolls. */
  readonly revealed = signal<TreeNode | null>(null);
  /** Number of changes of nodes: added, removed, geometry, visibility, opacity. */
  readonly changes = signal(0);
  readonly isEmpty = signal(false);
  readonly connection = signal<{ state: ConnectionState; reason: string }>({ state: "connecting", reason: "" });
  readonly status = signal<Status | null>(null);
  /** Updated once a second, as poses are shown. */
  readonly rates = signal({ nodes: 0, revision: 0, updates: 0, frames: 0 });
  readonly notice = signal({ text: "", centre: false });
  readonly graphicsNotice = signal("");
  /** True while clients stream images of the stereo camera. */
  readonly streaming = computed(() => (this.status.value?.facts ?? []).some(({ name, value }) => name === "streams" && Number(value) > 0));
  private updates = 0;
  private framesBefore = 0;

  select(node: TreeNode | null, reveal = false): void {
    batch(() => {
      this.awaited.value = null;
      this.selected.value = node;
      this.clicked.value = null;
      if (reveal) this.revealed.value = node;
    });
  }

  /** Apply an update to the scene and to the selection. */
  apply(update: SceneUpdate): ModelChange {
    const change = this.model.apply(update);
    this.updates += 1;
    batch(() => {
      if (change.added.length || change.removed.length || change.changed.size) this.changes.value += 1;
      this.followSelection();
      this.isEmpty.value = this.model.root.children.size === 0 && !this.model.root.parts;
      this.notice.value = { text: "", centre: false };
    });
    return change;
  }

  /** Select the node at the path of the selected one, after either was removed or added. */
  private followSelection(): void {
    const { selected, awaited, model } = this;
    if (selected.value && model.nodes.get(selected.value.id) !== selected.value) awaited.value = selected.value.path;
    if (!awaited.value) return;
    selected.value = model.find(awaited.value);
    if (selected.value) awaited.value = null;
  }

  setConnection(state: ConnectionState, reason: string): void {
    const [isOpen, isFirst] = [state === "open", this.model.revision === 0];
    const problem = reason || `The gateway does not respond; ${isFirst ? "this page keeps trying" : "this is the scene as it was"}.`;
    batch(() => {
      this.connection.value = { state, reason };
      this.notice.value = { text: isOpen ? "Waiting for the scene …" : problem, centre: isOpen || isFirst };
      if (!isOpen) this.status.value = null;
    });
  }

  /** Count the last second. Return true if there were updates. */
  tick(frames: number): boolean {
    const { updates, model } = this;
    this.rates.value = { nodes: model.nodes.size - 1, revision: model.revision, updates, frames: frames - this.framesBefore };
    this.framesBefore = frames;
    this.updates = 0;
    return updates > 0;
  }
}
