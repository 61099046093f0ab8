// Toolbar: panels, view directions, display options, downloads.

import { h } from "./dom";
import { icon, type Icon } from "./icons";
import type { Direction } from "./stage";
import { BACKGROUNDS, type Background } from "./theme";

const BACKGROUND_NAMES: Record<Background, string> = { theme: "By theme", white: "White", black: "Black", sky: "Sky" };

export interface ToolbarActions {
  panel(side: "left" | "right"): void;
  look(direction: Direction): void;
  fit(): void;
  orthographic(on: boolean): void;
  grid(on: boolean): void;
  axes(on: boolean): void;
  wireframe(on: boolean): void;
  pointSize(pixels: number): void;
  background(name: Background): void;
  theme(): void;
  snapshot(): void;
  /** URL of the scene's file with this view as its camera. */
  file(): string;
}

export interface Toolbar {
  element: HTMLElement;
  left: HTMLElement;
  right: HTMLElement;
  setGrid(on: boolean): void;
}

export function toolbar(actions: ToolbarActions, chosen: Background): Toolbar {
  const button = (name: Icon, title: string, run: () => void) =>
    h("button", { title, "aria-label": title, onclick: () => run() }, icon(name));
  const word = (text: string, title: string, run: () => void) => h("button", { title, onclick: () => run() }, text);
  const toggle = (name: Icon, title: string, on: boolean, run: (on: boolean) => void) => {
    const element = h("button", { title, "aria-label": title, "aria-pressed": String(on) }, icon(name));
    element.addEventListener("click", () => {
      const next = element.getAttribute("aria-pressed") !== "true";
      element.setAttribute("aria-pressed", String(next));
      run(next);
    });
    return element;
  };
  const gap = () => h("span", { class: "gap" });
  const points = h("input", {
    type: "range",
    min: 0,
    max: 12,
    step: 1,
    value: 0,
    title: "Point size in pixels; at the left end: as published",
    "aria-label": "Point size",
    oninput: (event) => actions.pointSize(Number((event.target as HTMLInputElement).value)),
  });
  const backgrounds = h(
    "select",
    {
      title: "Background",
      "aria-label": "Background",
      onchange: (event) => actions.background((event.target as HTMLSelectElement).value as Background),
    },
    ...BACKGROUNDS.map((name) => h("option", { value: name, selected: name === chosen }, BACKGROUND_NAMES[name])),
  );
  const grid = toggle("grid", "Grid on the ground", true, (on) => actions.grid(on));
  const left = button("tree", "Scene tree (T)", () => actions.panel("left"));
  const right = button("sensor", "Selection, stereo camera, renders (S)", () => actions.panel("right"));
  const file = h(
    "a",
    { class: "button", href: "/scene.glb", download: "scene.glb", title: "The scene as .glb, with this view as its camera" },
    icon("download"),
    ".glb",
  );
  file.addEventListener("click", () => (file.href = actions.file()));
  const tools = h(
    "div",
    { class: "tools", role: "toolbar", "aria-label": "View" },
    button("fit", "Fit the selection, or everything (F)", () => actions.fit()),
    button("home", "The home view: everything, from the front right, unless a client has set another (H)", () => actions.look("home")),
    word("Top", "From above (1)", () => actions.look("top")),
    word("Front", "From +X (2)", () => actions.look("front")),
    word("Side", "From −Y (3)", () => actions.look("side")),
    gap(),
    toggle("ortho", "Orthographic", false, (on) => actions.orthographic(on)),
    grid,
    toggle("axes", "Axes of the world: x red, y green, z blue", true, (on) => actions.axes(on)),
    toggle("wire", "Wireframe", false, (on) => actions.wireframe(on)),
    h("label", { class: "points" }, "Points ", points),
    backgrounds,
    gap(),
    button("snapshot", "This view as PNG, rendered by the gateway's own rasterizer", () => actions.snapshot()),
    file,
    button("theme", "Light or dark", () => actions.theme()),
  );
  const element = h("div", { class: "bar" }, left, h("span", { class: "brand" }, "Scenegate"), tools, right);
  const setGrid = (on: boolean) => {
    grid.setAttribute("aria-pressed", String(on));
    actions.grid(on);
  };
  return { element, left, right, setGrid };
}
