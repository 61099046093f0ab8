// Colours of a point cloud: as published, along an axis, or from one of its channels.

import { BufferAttribute, type BufferGeometry } from "three";
import { colorize, rangeOf, type MapName, type Range } from "./colormaps";
import type { Part } from "./protocol";

export interface CloudLook {
  /** "" as published, "x", "y", "z" of the cloud's own frame, or a channel as "name" or "name:component". */
  by: string;
  map: MapName;
}

/** The colour colorChoices of a cloud: value and label. */
export function colorChoices(part: Part): [string, string][] {
  const channels = Object.entries(part.channels ?? {}).flatMap(([name, width]): [string, string][] =>
    width <= 1 ? [[name, name]] : Array.from({ length: width }, (_, i) => [`${name}:${i}`, `${name} [${i}]`]),
  );
  return [["", "as published"], ["x", "x"], ["y", "y"], ["z", "z"], ...channels];
}

/** Set the colours of a cloud's geometry; resolves to the range of the values. */
export async function colorCloud(geometry: BufferGeometry, mesh: number, look: CloudLook): Promise<Range | null> {
  const position = geometry.getAttribute("position") as BufferAttribute;
  const axis = ["x", "y", "z"].indexOf(look.by);
  let values = position.array as Float32Array;
  let offset = axis;
  let stride = 3;
  if (axis < 0) {
    const [name = "", component = "0"] = look.by.split(/:(?=\d+$)/);
    const response = await fetch(`/view/channel/${mesh}?name=${encodeURIComponent(name)}`);
    if (!response.ok) return null;
    values = new Float32Array(await response.arrayBuffer());
    stride = Math.max(1, Math.round(values.length / position.count));
    offset = Number(component);
  }
  const range = rangeOf(values, offset, stride);
  geometry.setAttribute("color", new BufferAttribute(colorize(values, offset, stride, range, look.map), 4, true));
  return range;
}
