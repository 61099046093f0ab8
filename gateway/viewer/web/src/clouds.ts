// Colours of a point cloud: as published, along an axis, or from one of its channels.

import { colorize, type MapName, type Range, rangeOf } from "./colormaps";
import type { MeshPayload, Part } from "./protocol";

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
export async function colorCloud({ id, position }: MeshPayload, look: CloudLook): Promise<{ colors: Uint8Array; range: Range } | null> {
  const axis = ["x", "y", "z"].indexOf(look.by);
  let values = position;
  let offset = axis;
  let stride = 3;
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
