// Clicks that clients of the gateway asked for: report them, and show a pointer over clickable geometry.

import type { Drawing } from "./drawing";
import type { TreeNode } from "./model";
import type { Click, Path } from "./protocol";
import type { Stage } from "./stage";

/** Shortest time between two searches for the geometry under the pointer, ms. */
const HOVER_INTERVAL = 50;

export class Clicks {
  private paths: Path[] = [];
  private hovered: PointerEvent | null = null;
  private timer = 0;

  constructor(
    private readonly stage: Stage,
    private readonly drawing: Drawing,
    private readonly send: (click: Click) => void,
  ) {
    stage.canvas.addEventListener("pointermove", (event) => this.hover(event));
  }

  /** Set the paths at and below which geometry is clickable. */
  setPaths(paths: Path[]): void {
    this.paths = paths;
    if (!paths.length) this.stage.canvas.style.cursor = "";
  }

  /** Report a click on a node if a client wants it. */
  report(node: TreeNode, point: [number, number, number], button: Click["button"]): void {
    if (this.isClickable(node)) this.send({ node: node.id, point, button });
  }

  private isClickable(node: TreeNode): boolean {
    const { path } = node;
    return this.paths.some((top) => top.length <= path.length && top.every((name, i) => name === path[i]));
  }

  private hover(event: PointerEvent): void {
    if (!this.paths.length || event.buttons !== 0) return;
    this.hovered = event;
    this.timer ||= setTimeout(() => {
      this.timer = 0;
      if (this.paths.length && this.hovered) this.showCursor(this.hovered.clientX, this.hovered.clientY);
    }, HOVER_INTERVAL);
  }

  private showCursor(x: number, y: number): void {
    const hit = this.stage.pick(x, y);
    const node = hit && this.drawing.nodeAt(hit);
    this.stage.canvas.style.cursor = node && this.isClickable(node) ? "pointer" : "";
  }
}
