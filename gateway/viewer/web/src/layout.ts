// Layout: tree on the left, view, panels on the right. On small screens tree and panels are drawers, one open at a time.

import { h } from "./dom";
import { splitter } from "./splitter";
import type { Toolbar } from "./toolbar";

export type Side = "left" | "right";
const NARROW = matchMedia("(max-width: 899px)");

export class Layout {
  readonly element: HTMLElement;

  constructor(
    tree: HTMLElement,
    stage: HTMLElement,
    panels: HTMLElement,
    private readonly bar: Toolbar,
    private readonly onChange: () => void,
  ) {
    const shade = h("div", { class: "shade", onclick: () => this.closeDrawers() });
    this.element = h("div", { class: "layout" }, h("nav", { class: "drawer left" }, tree), stage, panels, shade);
    stage.append(splitter(this.element, "left", "Width of the scene tree"), splitter(this.element, "right", "Width of the panels"));
  }

  /** Open the tree if the screen has room for it, also after it was resized. */
  start(): void {
    const fit = () => {
      this.set("left", !NARROW.matches);
      this.set("right", false);
    };
    NARROW.addEventListener("change", fit);
    fit();
  }

  /** Open a panel if the screen has room for it. */
  openIfWide(side: Side): void {
    if (!NARROW.matches && !this.isOpen(side)) this.set(side, true);
  }

  isOpen(side: Side): boolean {
    return !this.element.classList.contains(`no-${side}`);
  }

  toggle(side: Side): void {
    const open = !this.isOpen(side);
    if (open && NARROW.matches) this.set(side === "left" ? "right" : "left", false);
    this.set(side, open);
  }

  /** Close drawers over the view; return true if one was open. */
  closeDrawers(): boolean {
    if (!NARROW.matches || !(this.isOpen("left") || this.isOpen("right"))) return false;
    this.set("left", false);
    this.set("right", false);
    return true;
  }

  private set(side: Side, open: boolean): void {
    this.element.classList.toggle(`no-${side}`, !open);
    this.bar[side].setAttribute("aria-pressed", String(open));
    this.onChange();
  }
}
