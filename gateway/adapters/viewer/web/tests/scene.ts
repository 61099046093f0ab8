// Updates of a scene, as the gateway sends them.

import type { NodeUpdate, SceneUpdate } from "../src/protocol";

/** Pose: x, y, z, qw, qx, qy, qz. */
type Pose = [number, number, number, number, number, number, number];

/** Return an update of the revision before with nodes, poses by id, and ids of removed nodes. */
export function update(revision: number, nodes: NodeUpdate[], poses: Record<number, Pose> = {}, removed: number[] = []): SceneUpdate {
  const ids = Uint32Array.from(Object.keys(poses).map(Number));
  const values = Float32Array.from(Object.values(poses).flat());
  return { kind: "update", from: revision - 1, revision, timestamp: 0, removed, nodes, poses: { ids, values } };
}
