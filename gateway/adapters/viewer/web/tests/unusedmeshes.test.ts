import { expect, it } from "vitest";
import { Model } from "../src/model";
import type { MeshPayload } from "../src/protocol";
import { update } from "./scene";

const MEGABYTES = 1 << 18;

function mesh(id: number, megabytes: number): MeshPayload {
  return { kind: "mesh", id, topology: 1, position: new Float32Array(megabytes * MEGABYTES) };
}

it("drops meshes of earlier states once they are large", () => {
  const model = new Model();
  const publish = (revision: number, id: number) => {
    model.meshes.set(id, mesh(id, 30));
    model.apply(
      update(revision, [
        { id: 1, parent: 0, name: "cloud", parts: [{ kind: "pointcloud", draws: [{ mesh: id, material: { color: [1, 1, 1, 1] } }] }] },
      ]),
    );
    return model.unusedMeshes();
  };
  expect([publish(1, 7), publish(2, 8)]).toEqual([[], []]);
  expect(publish(3, 9)).toEqual([7, 8]);
  for (const id of [7, 8]) model.meshes.delete(id);
  expect([publish(4, 10), publish(5, 11)]).toEqual([[], []]);
  expect(publish(6, 12)).toEqual([9, 10, 11]);
});
