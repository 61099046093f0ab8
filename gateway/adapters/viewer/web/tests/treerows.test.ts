import { expect, it } from "vitest";
import { Model } from "../src/model";
import { findTyped, listRows } from "../src/panels/treerows";
import { update } from "./scene";

const model = new Model();
const nodes = [
  { id: 1, parent: 0, name: "demo" },
  { id: 2, parent: 1, name: "robot" },
  { id: 3, parent: 2, name: "arm" },
  { id: 4, parent: 1, name: "table" },
  { id: 5, parent: 0, name: 3 },
];
model.apply(update(1, nodes));
const names = (search: string, depth = 2) => listRows(model, search, (row) => row.depth < depth).map(({ node }) => node.shownName);

it("lists open nodes, parents first", () => {
  expect(names("")).toEqual(["scene", "demo", "robot", "table", "3"]);
  expect(names("", 0)).toEqual(["scene"]);
  const table = listRows(model, "", () => true).find(({ node }) => node.name === "table");
  expect(table).toMatchObject({ depth: 2, position: 2, siblings: 2 });
});

it("lists the paths that contain a text, with their ancestors", () => {
  expect(names("Demo / Rob")).toEqual(["scene", "demo", "robot", "arm"]);
  expect(names("table")).toEqual(["scene", "demo", "table"]);
  expect(names("nothing")).toEqual([]);
});

it("finds the next name that starts with what is typed", () => {
  const rows = listRows(model, "", () => true);
  const found = (index: number, text: string) => rows[findTyped(rows, index, text)]!.node.shownName;
  expect(found(0, "t")).toBe("table");
  expect(found(2, "ro")).toBe("robot");
  expect(found(4, "d")).toBe("demo");
  expect(found(1, "x")).toBe("demo");
  expect(found(-1, "s")).toBe("scene");
});
