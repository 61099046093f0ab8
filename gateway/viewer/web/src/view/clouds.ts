// Colours of a point cloud: as published, along an axis, or from one of its channels.

import { BufferAttribute, type Points, type Material as ThreeMaterial } from "three";
import type { TreeNode } from "../model";
import type { Draw, MeshPayload, Part } from "../protocol";
import { colorize, type MapName, type Range, rangeOf } from "./colormaps";
import { chunkOf } from "./geometries";
import type { Materials } from "./materials";

export interface CloudLook {
  /** Source of the colours: "" as published, "x", "y", "z" in the cloud's frame, or a channel as "name" or "name:component". */
  by: string;
  map: MapName;
}

/** Return the choices for the colours of a cloud: value of `by` and label. */
export function colorChoices(part: Part): [string, string][] {
  const channels = Object.entries(part.channels ?? {}).flatMap(([name, width]): [string, string][] =>
    width <= 1 ? [[name, name]] : Array.from({ length: width }, (_, i) => [`${name}:${i}`, `${name} [${i}]`]),
  );
  return [["", "as published"], ["x", "x"], ["y", "y"], ["z", "z"], ...channels];
}

/** Return the colours of a cloud's points, RGBA, and the range of their values; null if it has no such channel. */
async function colorsOf({ id, position }: MeshPayload, look: CloudLook): Promise<{ colors: Uint8Array; range: Range } | null> {
  const axis = ["x", "y", "z"].indexOf(look.by);
  let [values, offset, stride] = [position, axis, 3];
  if (axis < 0) {
    const [name = "", component = "0"] = look.by.split(/:(?=\d+$)/);
    const response = await fetch(`view/channel/${id}?name=${encodeURIComponent(name)}`);
    if (!response.ok) return null;
    values = new Float32Array(await response.arrayBuffer());
    stride = Math.max(1, Math.round((3 * values.length) / position.length));
    offset = Number(component);
  }
  const range = rangeOf(values, offset, stride);
  return { colors: colorize(values, offset, stride, range, look.map), range };
}

/** Replace the colours of a cloud's chunks by those that the details panel has chosen for its node. */
export async function colorPoints(
  node: TreeNode,
  { material: { color, ...rest } }: Draw,
  objects: Points[],
  payload: MeshPayload,
  opacity: number,
  materials: Materials,
): Promise<void> {
  const colored = node.cloud && (await colorsOf(payload, node.cloud));
  const [first] = objects;
  if (!colored || !first?.parent) return;
  node.cloudRange = colored.range;
  materials.release(first.material as ThreeMaterial);
  const material = materials.acquire("points", { ...rest, color: [1, 1, 1, color[3]] }, true, opacity);
  objects.forEach((object, number) => {
    object.geometry = object.userData.ownGeometry = object.geometry.clone();
    object.geometry.setAttribute("color", new BufferAttribute(chunkOf(colored.colors, 4, number), 4, true));
    object.material = material;
  });
}
