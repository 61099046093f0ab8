import { Box3 } from "three";
import { expect, it } from "vitest";
import { type Frame, Model } from "../src/model";
import { describe as describeNode } from "../src/panels/describe";
import { frameChoices, toFrame } from "../src/tools/poseframes";
import { update } from "./scene";

const HALF = Math.SQRT1_2;
const model = new Model();
const nodes = [
  { id: 1, parent: 0, name: "robot" },
  { id: 2, parent: 1, name: "tool" },
  { id: 3, parent: 0, name: "bin" },
];
model.apply(update(1, nodes, { 1: [1, 0, 0, HALF, 0, 0, HALF], 2: [2, 0, 0, 1, 0, 0, 0], 3: [1, 0, 5, 1, 0, 0, 0] }));
const tool = model.find(["robot", "tool"])!;
const rows = (frame: Frame, node = tool, clicked: [number, number, number] | null = null) =>
  Object.fromEntries(describeNode(node, toFrame(model, node, frame), new Box3(), clicked));

it("shows a pose in the world, in the parent's frame and in that of any node", () => {
  expect(rows("world")).toMatchObject({ "Position (x y z, m)": "1  2  0", "Roll, pitch, yaw (degrees)": "0  0  90" });
  expect(rows("parent")).toMatchObject({ "Position (x y z, m)": "2  0  0", "Quaternion (w x y z)": "1  0  0  0" });
  expect(rows(["bin"])["Position (x y z, m)"]).toBe("0  2  -5");
  expect(rows(["robot", "tool"], model.find(["bin"])!)["Position (x y z, m)"]).toBe("-2  0  5");
  expect(rows("parent", model.root)["Position (x y z, m)"]).toBe("0  0  0");
});

it("shows the clicked point in the same frame", () => {
  expect(rows("world", tool, [1, 2, 3])["Clicked point (x y z, m)"]).toBe("1  2  3");
  expect(rows("parent", tool, [1, 2, 3])["Clicked point (x y z, m)"]).toBe("2  0  3");
  expect(rows("world")).not.toHaveProperty(["Clicked point (x y z, m)"]);
});

it("says that a frame is not in the scene", () => {
  expect(rows(["gone"]).Position).toMatch("not in the scene");
});

it("offers the frames of all nodes, and one that is gone", () => {
  const texts = (chosen: Frame, all: boolean) => frameChoices(model, chosen, all).map(([, text]) => text);
  expect(texts("world", false)).toEqual(["World", "Parent"]);
  expect(texts("world", true)).toEqual(["World", "Parent", "bin", "robot", "robot / tool"]);
  expect(texts(["gone"], false)).toEqual(["World", "Parent", "gone"]);
});
