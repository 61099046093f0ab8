import { expect, it } from "vitest";
import { Model } from "../src/model";
import { MAX_MARKS, markedNodes } from "../src/tools/marks";
import { update } from "./scene";

const nodes = [
  { id: 1, parent: 0, name: "robot" },
  { id: 2, parent: 1, name: "arm" },
  { id: 3, parent: 2, name: "tool" },
  { id: 4, parent: 0, name: "bin" },
];

function scene() {
  const model = new Model();
  model.apply(update(1, nodes));
  return model;
}
const found = (model: Model) => Object.fromEntries(markedNodes(model).map(([node, mark]) => [node.name, mark]));

it("marks a node, and all below it if that is chosen", () => {
  const model = scene();
  expect(found(model)).toEqual({});
  const robot = model.find(["robot"])!;
  robot.mark = { axes: true, name: false, below: false };
  model.find(["robot", "arm", "tool"])!.mark = { axes: false, name: true, below: false };
  const [axes, name] = [
    { axes: true, name: false },
    { axes: false, name: true },
  ];
  expect(found(model)).toEqual({ robot: axes, tool: name });
  robot.mark = { ...robot.mark, below: true };
  expect(found(model)).toEqual({ robot: axes, arm: axes, tool: { axes: true, name: true } });
});

it("marks no hidden nodes, keeps marks of nodes that are published again, and has a limit", () => {
  const model = scene();
  model.root.mark = { axes: true, name: true, below: true };
  model.find(["robot"])!.shown = false;
  model.find(["bin"])!.mark = { axes: false, name: true, below: false };
  expect(Object.keys(found(model))).toEqual(["", "bin"]);
  model.root.mark = null;
  model.apply(update(2, [], {}, [4]));
  expect(found(model)).toEqual({});
  model.apply(update(3, [{ id: 9, parent: 0, name: "bin" }]));
  expect(found(model)).toEqual({ bin: { axes: false, name: true } });
  model.root.mark = { axes: true, name: false, below: true };
  model.apply(
    update(
      4,
      Array.from({ length: 2 * MAX_MARKS }, (_, i) => ({ id: 10 + i, parent: 0, name: i })),
    ),
  );
  expect(markedNodes(model)).toHaveLength(MAX_MARKS);
});
