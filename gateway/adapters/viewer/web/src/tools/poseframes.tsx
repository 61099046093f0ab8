// Frame in which the details panel shows poses: the world, the parent, or any node.

import { type Signal, useSignal } from "@preact/signals";
import { Matrix4 } from "three";
import { pathText } from "../format";
import type { Frame, Model, TreeNode } from "../model";
import { Field } from "../widgets/controls";

/** Number of nodes among which a frame can be chosen. */
const MAX_FRAMES = 2000;

/** Return the frames that can be chosen: JSON and text. `all`: with those of all nodes. */
export function frameChoices(model: Model, chosen: Frame, all: boolean): [string, string][] {
  const paths = typeof chosen === "string" ? [] : [chosen];
  for (const node of all ? model.nodes.values() : []) if (node.parent && paths.length < MAX_FRAMES) paths.push(node.path);
  const texts = new Map(paths.map((path) => [JSON.stringify(path), pathText(path)]));
  return [['"world"', "World"], ['"parent"', "Parent"], ...[...texts].sort(([, a], [, b]) => (a < b ? -1 : 1))];
}

/** Return the transform from the world to a frame of a node; null if the frame is not in the scene, or flat. */
export function toFrame(model: Model, node: TreeNode, frame: Frame): Matrix4 | null {
  const base = frame === "parent" ? node.parent : frame === "world" ? null : model.find(frame);
  if (!base) return typeof frame === "string" ? new Matrix4() : null;
  return base.world.determinant() !== 0 ? base.world.clone().invert() : null;
}

export function FrameField({ model, frame }: { model: Model; frame: Signal<Frame> }) {
  const isUsed = useSignal(false); // the nodes are listed when the menu is used
  const use = () => (isUsed.value = true);
  return (
    <div onFocusIn={use} onPointerEnter={use}>
      <Field
        label="Relative to"
        value={JSON.stringify(frame.value)}
        choices={frameChoices(model, frame.value, isUsed.value)}
        onChange={(chosen) => (frame.value = JSON.parse(chosen))}
      />
    </div>
  );
}
