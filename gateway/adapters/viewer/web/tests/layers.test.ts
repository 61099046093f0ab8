// The order of the page's layers: a file imports from its own folder and from layers before it, also of types; no imports in a circle.

/// <reference types="vite/client" />
import ts from "typescript";
import { expect, it } from "vitest";

const LAYERS = [
  ...["protocol", "format", "options", "resources", "files"],
  ...["connection", "recorded", "model", "session"],
  ...["widgets", "view", "programs", "tools", "viewer", "panels"],
  ...["app", "main"],
];

const layerOf = (file: string) => LAYERS.indexOf(file.split("/")[0]!);

/** Return the files that a file imports, relative to `src`, without suffix. */
function importsOf(file: string, text: string): string[] {
  const names = ts.preProcessFile(text).importedFiles.map(({ fileName }) => fileName);
  const relative = names.filter((name) => name.startsWith(".") && !name.endsWith(".css"));
  return relative.map((name) => new URL(name, `file:///${file}`).pathname.slice(1));
}

/** Return the imports that break the order of `LAYERS`, and those that close a circle. */
function problemsOf(sources: Record<string, string>): string[] {
  const imports = new Map(Object.entries(sources).map(([file, text]) => [file, importsOf(file, text)]));
  const problems = [...imports.keys()].filter((file) => layerOf(file) < 0).map((file) => `${file} is in no layer`);
  const visited = new Set<string>();
  const visit = (file: string, importers: string[]): void => {
    if (importers.includes(file)) problems.push([...importers.slice(importers.indexOf(file)), file].join(" -> "));
    if (visited.has(file)) return;
    visited.add(file);
    for (const imported of imports.get(file) ?? []) {
      const isInFolder = file.includes("/") && layerOf(imported) === layerOf(file);
      if (!isInFolder && layerOf(imported) >= layerOf(file)) problems.push(`${file} imports ${imported}`);
      visit(imported, [...importers, file]);
    }
  };
  for (const file of imports.keys()) visit(file, []);
  return problems;
}

it("imports one way", () => {
  const files = import.meta.glob<string>("../src/**/*.{ts,tsx}", { query: "?raw", import: "default", eager: true });
  const sources = Object.fromEntries(Object.entries(files).map(([path, text]) => [path.replace(/^\.\.\/src\/|\.tsx?$/g, ""), text]));
  expect(Object.keys(sources)).toContain("view/stage");
  expect(problemsOf(sources)).toEqual([]);
});

it("finds imports against the order, circles and files without a layer", () => {
  const upward = { "view/stage": 'import type { Viewer } from "../viewer";', viewer: 'const panels = await import("./panels/panels");' };
  expect(problemsOf(upward)).toEqual(["view/stage imports viewer", "viewer imports panels/panels"]);
  const circle = { "view/a": 'import { b } from "./b";', "view/b": 'export type { A } from "./a";' };
  expect(problemsOf(circle)).toEqual(["view/a -> view/b -> view/a"]);
  expect(problemsOf({ helpers: 'import "three";' })).toEqual(["helpers is in no layer"]);
});
