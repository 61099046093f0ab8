// Toolbar: panels, view directions, the display menu, downloads.

import { directionButtons, displayMenu, type DisplayActions, type DisplayChoices } from "./displaymenu";
import { h } from "./dom";
import { icon, type Icon } from "./icons";

export interface ToolbarActions extends DisplayActions {
  /** Open or close a panel. */
  panel(side: "left" | "right"): void;
  fit(): void;
  snapshot(): void;
  /** URL of the scene's file with this view as its camera. */
  file(): string;
  /** URL of the gateway's image of this view. */
  rendering(): string;
}

export interface Toolbar {
  element: HTMLElement;
  /** Buttons of the panels on the left and the right. */
  left: HTMLElement;
  right: HTMLElement;
  setGrid(on: boolean): void;
}

export function toolbar(actions: ToolbarActions, chosen: DisplayChoices): Toolbar {
  const button = (name: Icon, title: string, run: () => void) =>
    h("button", { title, "aria-label": title, onclick: () => run() }, icon(name));
  const left = button("tree", "Scene tree (T)", () => actions.panel("left"));
  const right = button("panel", "Selection, stereo camera, renders (S)", () => actions.panel("right"));
  const download = (name: string, image: Icon, word: string, title: string, url: () => string) => {
    const link = h("a", { class: "button", href: "", download: name, title }, icon(image), h("span", { class: "word" }, word));
    link.addEventListener("click", () => (link.href = url()));
    return link;
  };
  const menu = displayMenu(actions, chosen);
  const tools = h(
    "div",
    { class: "tools", role: "toolbar", "aria-label": "View" },
    button("fit", "Fit the selection, or everything (F)", () => actions.fit()),
    button("home", "The home view: everything, from the front right, unless a client has set another (H)", () => actions.look("home")),
    h("div", { class: "directions" }, ...directionButtons(actions.look)),
    h("span", { class: "gap" }),
    menu.button,
    h("span", { class: "space" }),
    h(
      "button",
      { title: "This view as PNG", onclick: () => actions.snapshot() },
      icon("snapshot"),
      h("span", { class: "word" }, "PNG"),
    ),
    download("scenegate-render.png", "render", "Render", "This view by the gateway's rasterizer, as PNG", actions.rendering),
    download("scene.glb", "download", ".glb", "The visible scene as .glb, with this view as its camera", actions.file),
  );
  const brand = h("a", { class: "brand", href: "./", title: "All interfaces of this gateway" }, icon("cube"), h("span", { class: "word" }, "Scenegate"));
  const element = h("header", { class: "bar" }, left, h("h1", {}, brand), tools, right, menu.element);
  return { element, left, right, setGrid: menu.setGrid };
}
