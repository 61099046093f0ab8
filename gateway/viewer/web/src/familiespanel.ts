// Visibility and opacity of what Drake publishes: illustration, proximity, inertia, contacts, point clouds, frames.

import { h } from "./dom";
import { icon } from "./icons";
import type { Model, TreeNode } from "./model";

const ROOT = "drake";

export class FamiliesPanel {
  readonly element = h("section", { class: "families", "aria-label": "Drake", hidden: true });
  private shown = "";

  constructor(
    private readonly model: Model,
    private readonly changed: (node: TreeNode) => void,
  ) {}

  /** Show a row for each child of the node `drake`. */
  update(): void {
    const families = [...(this.model.find([ROOT])?.children ?? [])];
    const state = JSON.stringify(families.map((node) => [node.id, node.isShown, node.shownOpacity]));
    if (state === this.shown) return; // else a slider would be replaced while it is moved
    this.shown = state;
    this.element.hidden = families.length === 0;
    this.element.replaceChildren(h("h3", {}, "Drake"), ...families.map((node) => this.row(node)));
  }

  private row(node: TreeNode): HTMLElement {
    const name = String(node.name);
    const eye = h("button", { class: "eye", "aria-label": `${node.isShown ? "Hide" : "Show"} all ${name}` });
    eye.append(icon(node.isShown ? "eye" : "hidden"));
    eye.addEventListener("click", () => {
      node.shown = !node.isShown;
      this.changed(node);
      this.update();
    });
    const slider = h("input", { type: "range", min: 0, max: 1, step: 0.05, value: node.shownOpacity, "aria-label": `Opacity of ${name}` });
    slider.addEventListener("input", () => {
      node.ownOpacity = Number(slider.value);
      this.shown = "";
      this.changed(node);
    });
    slider.addEventListener("change", () => this.update());
    return h("div", { class: node.isShown ? "family" : "family hidden" }, eye, h("span", { class: "name" }, name), slider);
  }
}
