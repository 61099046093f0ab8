// What the details panel says of a node, as text: pose, bounds, geometry.

import { type Box3, Euler, Matrix4, Quaternion, Vector3 } from "three";
import { counted, pathText, shortRow } from "./format";
import type { Model, TreeNode } from "./model";
import type { Part, Path } from "./protocol";

/** Frame in which poses are shown; a path is that of a node. */
export type Frame = "world" | "parent" | Path;
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

function poseRows(pose: Matrix4, metres: number): [string, string][] {
  const [position, rotation, scale] = [new Vector3(), new Quaternion(), new Vector3()];
  pose.decompose(position, rotation, scale);
  const angles = new Euler().setFromQuaternion(rotation, "ZYX");
  const degrees = [angles.x, angles.y, angles.z].map((angle) => (angle * 180) / Math.PI);
  const rows: [string, string][] = [
    ["Position (x y z, m)", shortRow(position.toArray(), Math.min(1000, Math.max(metres, position.length())))],
    ["Roll, pitch, yaw (degrees)", shortRow(degrees, 360)],
    ["Quaternion (w x y z)", shortRow([rotation.w, rotation.x, rotation.y, rotation.z])],
  ];
  if (scale.distanceTo(new Vector3(1, 1, 1)) > 1e-6) rows.push(["Scale", shortRow(scale.toArray())]);
  return rows;
}

function partText(part: Part): string {
  const points = part.points === undefined ? "" : `${part.points} points`;
  return [part.kind, points, Object.keys(part.channels ?? {}).join(", "), part.source].filter(Boolean).join(" · ");
}

/**
 * Return names and values of a node: pose and clicked point in a frame, bounds in the world, geometry.
 *
 * @param fromWorld transform from the world to the frame; null: there is no such frame
 */
export function describe(node: TreeNode, fromWorld: Matrix4 | null, box: Box3, clicked: [number, number, number] | null): [string, string][] {
  const size = box.getSize(new Vector3());
  const longest = Math.max(size.x, size.y, size.z);
  const rows: [string, string][] = fromWorld
    ? poseRows(fromWorld.clone().multiply(node.world), longest)
    : [["Position", "no pose: the frame is not in the scene"]];
  if (fromWorld && clicked) {
    const point = new Vector3(...clicked).applyMatrix4(fromWorld);
    rows.unshift(["Clicked point (x y z, m)", shortRow(point.toArray(), Math.max(longest, 1e-3))]);
  }
  if (!box.isEmpty()) {
    const metres = Math.min(1000, Math.max(longest, new Vector3().setFromMatrixPosition(node.world).length()));
    rows.push(["Bounding box in the world (m)", [box.min, box.max].map((corner) => shortRow(corner.toArray(), metres)).join("\n")]);
    rows.push(["Size (m)", shortRow(size.toArray(), metres)]);
  }
  rows.push(["Geometry", counted((node.parts ?? []).map(partText)).join("\n") || "none"]);
  if (node.children.size) rows.push(["Children", String(node.children.size)]);
  return rows;
}
