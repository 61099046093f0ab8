// What the details panel says of a node, as text: pose, bounds, geometry.

import { type Box3, Euler, type Matrix4, Quaternion, Vector3 } from "three";
import { counted, shortRow } from "../format";
import type { TreeNode } from "../model";
import type { PagePart, Vector } from "../protocol";

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

function partText(part: PagePart): string {
  const points = part.points === undefined ? "" : `${part.points} points`;
  return [part.kind, points, Object.keys(part.channels ?? {}).join(", "), part.source].filter(Boolean).join(" · ");
}

/**
 * Return names and values of a node: pose and clicked point in a frame, bounds in the world, geometry.
 *
 * @param fromWorld transform from the world to the frame; null: there is no such frame
 */
export function describe(node: TreeNode, fromWorld: Matrix4 | null, box: Box3, clicked: Vector | null): [string, string][] {
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
