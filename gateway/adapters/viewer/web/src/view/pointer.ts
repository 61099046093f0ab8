// Clicks and taps on the view; those that clients of the gateway asked for are reported.

import type { TreeNode } from "../model";
import type { Click, Path, Vector } from "../protocol";

/** Buttons by their number in MouseEvent.button. */
const BUTTONS: readonly Click["button"][] = ["left", "middle", "right"];
/** Distance from which a movement between press and release is a drag, pixels. */
const DRAG_PIXELS = 5;
/** Shortest time between two searches for the geometry under the pointer, ms. */
const HOVER_INTERVAL = 50;

/** Call back with the place on the page of a click or tap, not of a drag. Enter is a tap in the middle. */
export function onTap(canvas: HTMLElement, tapped: (x: number, y: number, button: Click["button"]) => void): void {
  let press = { x: 0, y: 0 };
  canvas.addEventListener("pointerdown", ({ clientX: x, clientY: y }) => (press = { x, y }));
  const released = ({ button, clientX: x, clientY: y }: MouseEvent) => {
    const name = BUTTONS[button];
    if (name && Math.hypot(x - press.x, y - press.y) <= DRAG_PIXELS) tapped(x, y, name);
  };
  canvas.addEventListener("click", released);
  canvas.addEventListener("auxclick", released);
  canvas.addEventListener("keydown", ({ key }) => {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    if (key === "Enter") tapped(left + width / 2, top + height / 2, "left");
  });
}

/** Paths at and below which clients receive clicks; the pointer shows them. */
export class Clickable {
  private paths: Path[] = [];
  private hovered: PointerEvent | null = null;
  private timer = 0;

  /** @param nodeAt returns the node at a point of the page, pixels */
  constructor(
    private readonly canvas: HTMLElement,
    private readonly nodeAt: (x: number, y: number) => TreeNode | undefined,
    private readonly send: (click: Click) => void,
  ) {
    canvas.addEventListener("pointermove", (event) => {
      if (!this.paths.length || event.buttons !== 0) return;
      this.hovered = event;
      this.timer ||= setTimeout(() => this.showCursor(), HOVER_INTERVAL);
    });
  }

  setPaths(paths: Path[]): void {
    this.paths = paths;
    if (!paths.length) this.canvas.style.cursor = "";
  }

  /** Report a click on a node if a client wants it. */
  report(node: TreeNode, point: Vector, button: Click["button"]): void {
    if (this.has(node)) this.send({ node: node.id, point, button });
  }

  private has({ path }: TreeNode): boolean {
    return this.paths.some((top) => top.length <= path.length && top.every((name, i) => name === path[i]));
  }

  private showCursor(): void {
    this.timer = 0;
    if (!this.paths.length || !this.hovered) return;
    const node = this.nodeAt(this.hovered.clientX, this.hovered.clientY);
    this.canvas.style.cursor = node && this.has(node) ? "pointer" : "";
  }
}
