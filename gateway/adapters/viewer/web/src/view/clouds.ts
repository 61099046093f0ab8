// Colours of a point cloud: as published, or by a colormap along an axis or from one of its channels.

import { BufferAttribute, type Points, type Material as ThreeMaterial } from "three";
import type { CloudLook, MapName, Range, TreeNode } from "../model";
import type { Draw, MeshPayload, PagePart } from "../protocol";
import { addressOf, channelPath } from "../resources";
import { chunkOf } from "./geometries";
import type { Materials } from "./materials";

/** Stops at equal distances; viridis and turbo as they are published. */
export const COLOR_MAPS = {
  turbo: ["#30123b", "#466be3", "#29bbec", "#31f299", "#a4fc3c", "#edd03a", "#fb8022", "#d23105", "#7a0403"],
  viridis: ["#440154", "#472c7a", "#3b518b", "#2c718e", "#21908d", "#27ad81", "#5cc863", "#aadc32", "#fde725"],
  grey: ["#141414", "#fafafa"],
  "blue–red": ["#3b4cc0", "#dddddd", "#b40426"],
} as const satisfies Record<MapName, readonly string[]>;

/** Return the range of the finite values; 0 to 1 if there are none. */
export function rangeOf(values: Float32Array, offset: number, stride: number): Range {
  let [low, high] = [Infinity, -Infinity];
  for (let i = offset; i < values.length; i += stride) {
    const value = values[i] ?? NaN;
    if (value < low && value > -Infinity) low = value;
    if (value > high && value < Infinity) high = value;
  }
  return low <= high ? { low, high } : { low: 0, high: 1 };
}

/** Return 256 colours of a map, red, green and blue bytes. */
function tableOf(map: MapName): Uint8Array {
  const stops = COLOR_MAPS[map].map((stop) => [1, 3, 5].map((at) => Number.parseInt(stop.slice(at, at + 2), 16)));
  return Uint8Array.from({ length: 3 * 256 }, (_, i) => {
    const at = (Math.floor(i / 3) / 255) * (stops.length - 1);
    const k = Math.min(Math.floor(at), stops.length - 2);
    const [low, high] = [stops[k]![i % 3]!, stops[k + 1]![i % 3]!];
    return Math.round(low + (at - k) * (high - low));
  });
}

/** Return RGBA bytes for every value; NaN is grey. */
export function colorize(values: Float32Array, offset: number, stride: number, range: Range, map: MapName): Uint8Array {
  const table = tableOf(map);
  const count = Math.floor((values.length - offset + stride - 1) / stride);
  const colors = new Uint8Array(4 * count);
  const scale = range.high > range.low ? 255 / (range.high - range.low) : 0;
  for (let i = 0; i < count; i++) {
    const value = values[offset + i * stride] ?? NaN;
    const index = 3 * Math.max(0, Math.min(255, Math.round((value - range.low) * scale)));
    for (let c = 0; c < 3; c++) colors[4 * i + c] = Number.isNaN(value) ? 128 : table[index + c]!;
    colors[4 * i + 3] = 255;
  }
  return colors;
}

/** Return a colormap as a CSS background. */
export function ramp(map: MapName): string {
  return `linear-gradient(90deg, ${COLOR_MAPS[map].join(", ")})`;
}

/** Return the choices for the colours of a cloud: value of `by` and label. */
export function colorChoices(part: PagePart): [string, string][] {
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
    const response = await fetch(addressOf(channelPath(id, name)));
    if (!response.ok) return null;
    values = new Float32Array(await response.arrayBuffer());
    stride = Math.max(1, Math.round((3 * values.length) / position.length));
    offset = Number(component);
  }
  const range = rangeOf(values, offset, stride);
  return { colors: colorize(values, offset, stride, range, look.map), range };
}

/** Replace the colours of a cloud's chunks by those that the details panel has chosen for its node. */
export async function colorPoints(node: TreeNode, draw: Draw, objects: Points[], payload: MeshPayload, materials: Materials): Promise<void> {
  const { color, ...rest } = draw.material;
  const colored = node.cloud && (await colorsOf(payload, node.cloud));
  const [first] = objects;
  if (!colored || !first?.parent) return;
  node.cloudRange = colored.range;
  materials.release(first.material as ThreeMaterial);
  const material = materials.acquire("points", { ...rest, color: [1, 1, 1, color[3]] }, true, node.combinedOpacity);
  objects.forEach((object, number) => {
    object.geometry = object.userData.ownGeometry = object.geometry.clone();
    object.geometry.setAttribute("color", new BufferAttribute(chunkOf(colored.colors, 4, number), 4, true));
    object.material = material;
  });
}
