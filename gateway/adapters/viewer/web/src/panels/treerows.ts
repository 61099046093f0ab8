// The rows of the tree panel.

import type { Model, TreeNode } from "../model";

export interface Row {
  node: TreeNode;
  depth: number;
  /** Number among its siblings, from 1. */
  position: number;
  siblings: number;
}

/** Return the rows of the tree; with a search, those of paths that contain the text, and of their ancestors. */
export function listRows(model: Model, search: string, isOpen: (row: Row) => boolean): Row[] {
  const text = search.trim().toLowerCase();
  const wanted = text.replace(/\s*\/\s*/g, "/");
  const matching = wanted ? findMatching(model, wanted) : null;
  const rows: Row[] = [];
  const stack: Row[] = matching?.size === 0 ? [] : [{ node: model.root, depth: 0, position: 1, siblings: 1 }];
  for (let row = stack.pop(); row; row = stack.pop()) {
    rows.push(row);
    if (!matching && !isOpen(row)) continue;
    const depth = row.depth + 1;
    const children = [...row.node.children].filter((node) => !matching || matching.has(node));
    stack.push(...children.map((node, i) => ({ node, depth, position: i + 1, siblings: children.length })).reverse());
  }
  return rows;
}

/** Return the nodes whose path, such as /demo/robot, contains the text, and their ancestors. */
function findMatching(model: Model, text: string): Set<TreeNode> {
  const found = new Set<TreeNode>();
  const paths = new Map<TreeNode, string>();
  for (const node of model.nodes.values()) {
    if (!node.parent) continue;
    const path = `${paths.get(node.parent) ?? ""}/${String(node.name).toLowerCase()}`; // parents come first
    paths.set(node, path);
    if (path.includes(text)) for (let at: TreeNode | null = node; at && !found.has(at); at = at.parent) found.add(at);
  }
  return found;
}

/** Return the index of the next row whose name starts with a text that is being typed; `index` if there is none. */
export function findTyped(rows: Row[], index: number, text: string): number {
  const start = index + (text.length === 1 ? 1 : 0);
  const order = rows.map((_, i) => (start + i + rows.length) % rows.length);
  const names = rows.map(({ node }) => node.shownName.toLowerCase());
  return order.find((i) => names[i]!.startsWith(text)) ?? index;
}
