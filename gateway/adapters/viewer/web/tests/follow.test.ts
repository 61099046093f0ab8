import { expect, it } from "vitest";
import { Model } from "../src/model";
import { Follow, moved } from "../src/tools/follow";
import { update } from "./scene";

const ROBOT = { id: 1, parent: 0, name: "robot" };
const HALF = Math.SQRT1_2;
const VIEW = { eye: [3, 0, 1], target: [1, 0, 0], up: [0, 0, 1] } as const;
const view = { eye: [...VIEW.eye], target: [...VIEW.target], up: [...VIEW.up] } as Parameters<typeof moved>[0];

function followed(mode: "follow" | "ride") {
  const model = new Model();
  model.apply(update(1, [ROBOT], { 1: [1, 0, 0, 1, 0, 0, 0] }));
  const follow = new Follow(model);
  follow.start({ path: ["robot"], mode });
  return { model, follow };
}

const rounded = (camera: typeof view) => [...camera.eye, ...camera.target, ...camera.up].map((x) => Math.round(x * 1e6) / 1e6 + 0);

it("moves the camera with a node and keeps its heading", () => {
  const { model, follow } = followed("follow");
  expect(follow.motion()).toBeNull();
  model.apply(update(2, [], { 1: [5, 2, 0, HALF, 0, 0, HALF] }));
  const motion = follow.motion()!;
  expect(rounded(moved(view, motion))).toEqual([7, 2, 1, 5, 2, 0, 0, 0, 1]);
  expect(follow.motion()).toBeNull();
});

it("turns the camera with a node that it rides on", () => {
  const { model, follow } = followed("ride");
  model.apply(update(2, [], { 1: [5, 2, 0, HALF, 0, 0, HALF] })); // to the left
  expect(rounded(moved(view, follow.motion()!))).toEqual([5, 4, 1, 5, 2, 0, 0, 0, 1]);
  model.apply(update(3, [], { 1: [5, 2, 0, HALF, HALF, 0, 0] })); // on its side
  const again = moved(view, follow.motion()!);
  expect(again.up).not.toEqual([0, 0, 1]);
});

it("waits for a node that is removed, and goes on where it is published", () => {
  const { model, follow } = followed("follow");
  model.apply(update(2, [], {}, [1]));
  expect(follow.motion()).toBeNull();
  expect(follow.isThere.value).toBe(false);
  model.apply(update(3, [{ ...ROBOT, id: 7 }], { 7: [1, 0, 9, 1, 0, 0, 0] }));
  expect(rounded(moved(view, follow.motion()!)).slice(0, 3)).toEqual([3, 0, 10]);
  expect(follow.isThere.value).toBe(true);
});

it("places the camera of a link when its node is published", () => {
  const { model, follow } = followed("ride");
  model.apply(update(2, [], { 1: [5, 2, 0, HALF, 0, 0, HALF] }));
  const placed = moved(view, follow.motion()!);
  const link = follow.relative(placed);
  expect(rounded(link)).toEqual(rounded({ eye: [2, 0, 1], target: [0, 0, 0], up: [0, 0, 1] }));
  const later = new Model();
  const other = new Follow(later);
  other.start({ path: ["robot"], mode: "ride" }, true);
  expect(other.motion()).toBeNull();
  later.apply(update(1, [ROBOT], { 1: [5, 2, 0, HALF, 0, 0, HALF] }));
  expect(rounded(moved(link, other.motion()!))).toEqual(rounded(placed));
});

it("changes the mode without a motion, and ignores poses that are not finite", () => {
  const { model, follow } = followed("follow");
  model.apply(update(2, [], { 1: [1, 0, 0, HALF, 0, 0, HALF] }));
  expect(rounded(moved(view, follow.motion()!))).toEqual(rounded(view));
  follow.setMode("ride");
  expect(follow.motion()).toBeNull();
  expect(follow.modeOf(model.find(["robot"]))).toBe("ride");
  expect(follow.modeOf(model.root)).toBeNull();
  model.apply(update(3, [], { 1: [Number.NaN, 0, 0, 1, 0, 0, 0] }));
  expect(follow.motion()).toBeNull();
  follow.stop();
  model.apply(update(4, [], { 1: [9, 0, 0, 1, 0, 0, 0] }));
  expect(follow.motion()).toBeNull();
});
