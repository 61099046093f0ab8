// The tree of paths: expand, search, hide, select. Only visible rows are elements, so thousands of nodes are fast.

import { counted, h, pathText } from "./dom";
import { FamiliesPanel } from "./familiespanel";
import { icon } from "./icons";
import type { Model, TreeNode } from "./model";

/** Height of a row, CSS pixels: a finger needs more than a pointer. */
const ROW = matchMedia("(pointer: coarse)").matches ? 40 : 26;
const OPEN_AT_FIRST = 2;
/** Time after which a character starts a new search for a name. */
const TYPING_MS = 700;

interface Row {
  node: TreeNode;
  depth: number;
  /** Number among its siblings, from 1. */
  position: number;
  siblings: number;
}

export class TreePanel {
  readonly element = h("section", { class: "tree", "aria-label": "Scene tree" });
  private readonly search = h("input", { type: "search", placeholder: "Search paths", "aria-label": "Search paths" });
  private readonly list = h("div", { class: "rows", role: "tree", tabindex: 0, "aria-label": "Paths" });
  private readonly spacer = h("div", { class: "spacer" });
  private readonly nothing = h("p", { class: "empty", role: "status" });
  private readonly families: FamiliesPanel;
  private readonly toggled = new Map<number, boolean>();
  private rows: Row[] = [];
  private selected: TreeNode | null = null;
  private scheduled = false;
  /** Characters typed to find a row, and when the last one was, `Event.timeStamp`. */
  private typed = { text: "", time: 0 };

  constructor(
    private readonly model: Model,
    private readonly onSelect: (node: TreeNode | null) => void,
    private readonly onShow: (node: TreeNode) => void,
    private readonly onFocus: (node: TreeNode) => void,
  ) {
    this.element.style.setProperty("--row", `${ROW}px`);
    this.families = new FamiliesPanel(model, (node) => {
      this.onShow(node);
      this.paint();
    });
    this.element.append(h("header", {}, this.search), this.families.element, this.nothing, this.list);
    this.list.append(this.spacer);
    this.search.addEventListener("input", () => this.update());
    this.list.addEventListener("scroll", () => this.paint());
    this.list.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.paint()).observe(this.list);
    this.update();
  }

  /** Update the rows after nodes were added or removed. */
  update(): void {
    if (this.scheduled) return;
    this.scheduled = true;
    requestAnimationFrame(() => {
      this.scheduled = false;
      this.rows = this.listRows();
      this.families.update();
      this.paint();
    });
  }

  select(node: TreeNode | null, reveal = false): void {
    this.selected = node;
    if (node && reveal) {
      for (let at = node.parent; at; at = at.parent) this.toggled.set(at.id, true);
      this.rows = this.listRows();
      const index = this.rows.findIndex((row) => row.node === node);
      const top = index * ROW;
      if (index >= 0 && (top < this.list.scrollTop || top > this.list.scrollTop + this.list.clientHeight - ROW))
        this.list.scrollTop = top - this.list.clientHeight / 2;
    }
    this.paint();
  }

  private listRows(): Row[] {
    const wanted = this.search.value.trim().toLowerCase().replace(/\s*\/\s*/g, "/");
    const rows: Row[] = [];
    const stack: Row[] = [{ node: this.model.root, depth: 0, position: 1, siblings: 1 }];
    const matching = wanted ? this.matching(wanted) : null;
    this.nothing.textContent = matching?.size === 0 ? `No path contains “${this.search.value.trim()}”.` : "";
    this.nothing.hidden = matching?.size !== 0;
    if (matching?.size === 0) return rows;
    for (let row = stack.pop(); row; row = stack.pop()) {
      rows.push(row);
      if (!this.isOpen(row.node, row.depth)) continue;
      const depth = row.depth + 1;
      const children = [...row.node.children].filter((node) => !matching || matching.has(node));
      stack.push(...children.map((node, i) => ({ node, depth, position: i + 1, siblings: children.length })).reverse());
    }
    return rows;
  }

  /** Return the nodes whose path, such as /demo/robot, contains the text, and their ancestors. */
  private matching(text: string): Set<TreeNode> {
    const found = new Set<TreeNode>();
    const paths = new Map<TreeNode, string>();
    for (const node of this.model.nodes.values()) {
      if (!node.parent) continue;
      const path = `${paths.get(node.parent) ?? ""}/${String(node.name).toLowerCase()}`; // parents come first
      paths.set(node, path);
      if (path.includes(text)) for (let at: TreeNode | null = node; at && !found.has(at); at = at.parent) found.add(at);
    }
    return found;
  }

  private isOpen(node: TreeNode, depth: number): boolean {
    return this.search.value.trim() !== "" || (this.toggled.get(node.id) ?? depth < OPEN_AT_FIRST);
  }

  private paint(): void {
    this.spacer.style.height = `${this.rows.length * ROW}px`;
    const first = Math.max(0, Math.floor(this.list.scrollTop / ROW) - 4);
    const last = Math.min(this.rows.length, first + Math.ceil(this.list.clientHeight / ROW) + 8);
    const shown = this.rows.slice(first, last).map((row, i) => this.row(row, (first + i) * ROW));
    this.list.replaceChildren(this.spacer, ...shown);
    // The tree has the focus; screen readers read its selected row.
    if (this.selected) this.list.setAttribute("aria-activedescendant", `row-${this.selected.id}`);
    else this.list.removeAttribute("aria-activedescendant");
  }

  private row({ node, depth, position, siblings }: Row, top: number): HTMLElement {
    const open = this.isOpen(node, depth);
    const name = node.parent ? String(node.name) || '""' : "scene";
    const arrow = h("button", {
      class: "arrow",
      tabindex: -1,
      "aria-label": `${open ? "Collapse" : "Expand"} ${name}`,
      "aria-expanded": String(open),
      onclick: (event) => {
        event.stopPropagation();
        this.toggle(node, depth);
      },
    });
    if (node.children.size) arrow.append(icon("chevron"));
    else arrow.disabled = true;
    const eye = h("button", {
      class: "eye",
      tabindex: -1,
      "aria-label": `${node.isShown ? "Hide" : "Show"} ${name}`,
      title: node.isShown ? "Hide" : "Show",
      onclick: (event) => {
        event.stopPropagation();
        this.setShown(node, !node.isShown);
      },
    });
    eye.append(icon(node.isShown ? "eye" : "hidden"));
    const label = h("span", { class: typeof node.name === "number" ? "name number" : "name", title: pathText(node.path) }, name);
    const kindNames = counted(node.parts?.map((part) => part.kind) ?? []).join(", ");
    const kinds = h("span", { class: "kinds", title: kindNames }, kindNames);
    const element = h(
      "div",
      {
        class: `row${node === this.selected ? " selected" : ""}${node.isShown ? "" : " hidden"}`,
        role: "treeitem",
        id: `row-${node.id}`,
        "aria-level": depth + 1,
        "aria-posinset": position,
        "aria-setsize": siblings,
        "aria-selected": String(node === this.selected),
        "data-path": JSON.stringify(node.path),
        onclick: () => this.onSelect(node),
        ondblclick: () => this.onFocus(node),
      },
      arrow,
      label,
      kinds,
      eye,
    );
    if (node.children.size) element.setAttribute("aria-expanded", String(open));
    element.style.top = `${top}px`;
    element.style.paddingLeft = `${6 + depth * 14}px`;
    return element;
  }

  private toggle(node: TreeNode, depth: number): void {
    this.toggled.set(node.id, !this.isOpen(node, depth));
    this.rows = this.listRows();
    this.paint();
  }

  private setShown(node: TreeNode, shown: boolean): void {
    node.shown = shown;
    this.onShow(node);
    this.families.update();
    this.paint();
  }

  /** Return the next row whose name starts with the characters that were typed in quick succession. */
  private findTyped(index: number, { key, timeStamp }: KeyboardEvent): number {
    const quick = timeStamp - this.typed.time < TYPING_MS;
    const text = (quick ? this.typed.text : "") + key.toLowerCase();
    this.typed = { text, time: timeStamp };
    const count = this.rows.length;
    const order = this.rows.map((_, i) => (index + i + (text.length === 1 ? 1 : 0) + count) % count);
    return order.find((i) => String(this.rows[i]?.node.name).toLowerCase().startsWith(text)) ?? index;
  }

  private key(event: KeyboardEvent): void {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const index = this.rows.findIndex((row) => row.node === this.selected);
    const row = this.rows[index];
    const go = (to: number) => {
      const next = this.rows[Math.min(Math.max(to, 0), this.rows.length - 1)];
      if (next) {
        this.onSelect(next.node);
        this.select(next.node, true);
      }
    };
    if (event.key === "ArrowDown") go(index + 1);
    else if (event.key === "ArrowUp") go(index - 1);
    else if (event.key === "Home") go(0);
    else if (event.key === "End") go(this.rows.length - 1);
    else if (event.key.length === 1 && event.key !== " ") go(this.findTyped(index, event));
    else if (!row) return;
    else if (event.key === "ArrowRight") {
      if (!row.node.children.size) return;
      if (this.isOpen(row.node, row.depth)) go(index + 1);
      else this.toggle(row.node, row.depth);
    } else if (event.key === "ArrowLeft") {
      const canClose = row.node.children.size && this.isOpen(row.node, row.depth) && this.search.value.trim() === "";
      if (canClose) this.toggle(row.node, row.depth);
      else go(this.rows.findIndex(({ node }) => node === row.node.parent));
    }
    else if (event.key === " ") this.setShown(row.node, !row.node.isShown);
    else if (event.key === "Enter") this.onFocus(row.node);
    else return;
    event.preventDefault();
  }
}
