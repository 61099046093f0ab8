// Updates of a scene, as the gateway sends them.

import type { NodeUpdate, SceneUpdate } from "../src/protocol";

/** Pose: x, y, z, qw, qx, qy, qz. */
type Pose = [number, number, number, number, number, number, number];

/** Return an update of the revision before with nodes, poses by id, and ids of removed nodes. */
export function update(revision: number, nodes: NodeUpdate[], poses: Record<number, Pose> = {}, removed: number[] = []): SceneUpdate {
  const none = { matrixIds: new Uint32Array(), matrices: new Float64Array() };
  const ids = Object.keys(poses).map(Number);
  const values = { poseIds: Uint32Array.from(ids), poses: Float32Array.from(Object.values(poses).flat()) };
  return { kind: "update", from: revision - 1, revision, removed, nodes, ...values, ...none };
}
