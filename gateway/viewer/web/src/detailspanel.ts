// Panel of the selected node: path, pose, bounds, geometry, opacity, colours of a point cloud.

import { Euler, Quaternion, Vector3, type Box3 } from "three";
import { colorChoices } from "./clouds";
import { COLOR_MAPS, ramp, type MapName } from "./colormaps";
import { counted, h, pathText, short, shortRow } from "./dom";
import { icon } from "./icons";
import type { TreeNode } from "./model";
import type { Path } from "./protocol";

export interface DetailsActions {
  boundsOf(node: TreeNode): Box3;
  /** Called when opacity, visibility or cloud colours of a node changed. */
  changed(node: TreeNode): void;
  fit(node: TreeNode): void;
  close(): void;
}

export class DetailsPanel {
  readonly element = h("section", { class: "details", "aria-label": "Selection" });
  private node: TreeNode | null = null;
  private readonly values = h("dl");
  /** JSON of the rows in `values`. */
  private shown = "";
  private readonly ends = h("div", { class: "ramp-ends" });

  constructor(private readonly actions: DetailsActions) {
    this.show(null);
  }

  /** @param awaited path of a selected node that was removed */
  show(node: TreeNode | null, awaited: Path | null = null): void {
    this.node = node;
    if (!node) {
      const text = awaited
        ? `${pathText(awaited)} is not in the scene any more. It is selected again when it is published.`
        : "Nothing is selected. Click something in the view or in the tree.";
      this.element.replaceChildren(h("p", { class: "empty" }, text));
      return;
    }
    const { actions } = this;
    this.element.replaceChildren(
      h(
        "header",
        {},
        h("h2", {}, pathText(node.path)),
        h("button", { class: "plain", onclick: () => actions.fit(node), title: "Fit the view to it (F)" }, icon("fit"), "Fit"),
        h("button", { onclick: () => actions.close(), "aria-label": "Deselect", title: "Deselect (Esc)" }, icon("close")),
      ),
      this.opacity(node),
      ...this.cloud(node),
      this.values,
    );
    this.update();
  }

  private opacity(node: TreeNode): HTMLElement {
    const output = h("output", {}, `${Math.round(node.shownOpacity * 100)} %`);
    const slider = h("input", { type: "range", min: 0, max: 1, step: 0.05, value: node.shownOpacity, "aria-label": "Opacity" });
    slider.addEventListener("input", () => {
      node.ownOpacity = Number(slider.value);
      output.textContent = `${Math.round(node.shownOpacity * 100)} %`;
      this.actions.changed(node);
    });
    return h("label", { class: "field" }, "Opacity", slider, output);
  }

  private cloud(node: TreeNode): HTMLElement[] {
    const part = node.parts?.find((each) => each.points !== undefined);
    if (!part) return [];
    const by = h("select", { "aria-label": "Colour by" }, ...colorChoices(part).map(([value, text]) => h("option", { value }, text)));
    const map = h("select", { "aria-label": "Colour map" }, ...Object.keys(COLOR_MAPS).map((name) => h("option", {}, name)));
    by.value = node.cloud?.by ?? "";
    map.value = node.cloud?.map ?? "turbo";
    const bar = h("div", { class: "ramp" });
    const legend = h("div", {}, bar, this.ends);
    const apply = (tell: boolean) => {
      const name = map.value as MapName;
      node.cloud = by.value ? { by: by.value, map: name } : null;
      bar.style.background = ramp(name);
      legend.hidden = mapField.hidden = !by.value;
      if (tell) this.actions.changed(node);
    };
    const mapField = h("label", { class: "field" }, "Colour map", map);
    by.addEventListener("change", () => apply(true));
    map.addEventListener("change", () => apply(true));
    apply(false);
    return [h("label", { class: "field" }, "Colour by", by), mapField, legend];
  }

  /** Show the current pose and bounds. */
  update(): void {
    const { node } = this;
    if (!node) return;
    const position = new Vector3();
    const rotation = new Quaternion();
    const scale = new Vector3();
    node.world.decompose(position, rotation, scale);
    const angles = new Euler().setFromQuaternion(rotation, "ZYX");
    const degrees = [angles.x, angles.y, angles.z].map((angle) => (angle * 180) / Math.PI);
    const box = this.actions.boundsOf(node);
    const size = box.getSize(new Vector3());
    const metres = Math.min(1000, Math.max(size.x, size.y, size.z, position.length()));
    const rows: [string, string][] = [
      ["Position in the world (x y z, m)", shortRow(position.toArray(), metres)],
      ["Roll, pitch, yaw (degrees)", shortRow(degrees, 360)],
      ["Quaternion (w x y z)", shortRow([rotation.w, rotation.x, rotation.y, rotation.z])],
    ];
    if (scale.distanceTo(new Vector3(1, 1, 1)) > 1e-6) rows.push(["Scale", shortRow(scale.toArray())]);
    if (!box.isEmpty()) {
      rows.push(["Bounding box (m)", [box.min, box.max].map((corner) => shortRow(corner.toArray(), metres)).join("\n")]);
      rows.push(["Size (m)", shortRow(size.toArray(), metres)]);
    }
    const parts = (node.parts ?? []).map((part) => {
      const facts = [part.kind];
      if (part.points !== undefined) facts.push(`${part.points} points`);
      const channels = Object.keys(part.channels ?? {});
      if (channels.length) facts.push(channels.join(", "));
      if (part.source) facts.push(part.source);
      return facts.join(" · ");
    });
    rows.push(["Geometry", counted(parts).join("\n") || "none"]);
    if (node.children.size) rows.push(["Children", String(node.children.size)]);
    const range = node.cloudRange;
    this.ends.replaceChildren(...(range ? [h("span", {}, short(range.low)), h("span", {}, short(range.high))] : []));
    const shown = JSON.stringify(rows);
    const selection = getSelection();
    if (shown === this.shown || (selection?.isCollapsed === false && selection.containsNode(this.values, true))) return;
    this.shown = shown;
    this.values.replaceChildren(...rows.flatMap(([name, value]) => [h("dt", {}, name), h("dd", {}, value)]));
  }
}
