// Menu of the display settings. It opens below its button in the toolbar.

import { h } from "./dom";
import { icon } from "./icons";
import { keep } from "./options";
import type { Direction } from "./stage";
import { BACKGROUNDS, type Background, type Theme } from "./theme";

/** Width of the menu with its margin, as in style.css, pixels. */
const MENU_WIDTH = 246;
const BACKGROUND_NAMES: Record<Background, string> = { theme: "By theme", white: "White", black: "Black", sky: "Sky" };

/** Settings that are on or off. The browser keeps them. */
type Switch = "grid" | "axes" | "wireframe" | "orthographic" | "shadows" | "occlusion" | "shortcuts";

/** Callbacks of the controls in the menu. */
export interface DisplayActions extends Record<Switch, (on: boolean) => void> {
  look(direction: Direction): void;
  /** 0: as published. */
  pointSize(pixels: number): void;
  background(name: Background): void;
  theme(name: Theme): void;
}

/** Settings at the start. */
export interface DisplayChoices extends Record<Switch, boolean> {
  background: Background;
  theme: Theme;
}

export interface DisplayMenu {
  button: HTMLElement;
  element: HTMLElement;
  /** Show or hide the grid, and update the checkbox. */
  setGrid(on: boolean): void;
}

export function directionButtons(look: (direction: Direction) => void): HTMLElement[] {
  const button = (text: string, title: string, direction: Direction) => h("button", { title, onclick: () => look(direction) }, text);
  return [button("Top", "From above (1)", "top"), button("Front", "From +X (2)", "front"), button("Side", "From −Y (3)", "side")];
}

export function displayMenu(actions: DisplayActions, chosen: DisplayChoices): DisplayMenu {
  const check = (text: string, title: string, on: boolean, change: (on: boolean) => void) => {
    const box = h("input", { type: "checkbox", checked: on, onchange: () => change(box.checked) });
    return h("label", { class: "check", title }, box, text);
  };
  const kept = (name: Switch, text: string, title = "") => {
    actions[name](chosen[name]);
    return check(text, title, chosen[name], (on) => {
      keep(name, on ? "on" : "off");
      actions[name](on);
    });
  };
  const grid = kept("grid", "Grid on the ground");
  const points = h("input", {
    type: "range",
    min: 0,
    max: 12,
    step: 1,
    value: 0,
    title: "Pixels; at the left end: as published",
    "aria-label": "Point size",
    oninput: () => {
      actions.pointSize(Number(points.value));
      pixels.textContent = points.value === "0" ? "as sent" : `${points.value} px`;
    },
  });
  const pixels = h("output", {}, "as sent");
  const backgrounds = h(
    "select",
    { "aria-label": "Background", onchange: () => actions.background(backgrounds.value as Background) },
    ...BACKGROUNDS.map((name) => h("option", { value: name, selected: name === chosen.background }, BACKGROUND_NAMES[name])),
  );
  const dark = check("Dark theme", "", chosen.theme === "dark", (on) => actions.theme(on ? "dark" : "light"));
  const group = (title: string, ...content: HTMLElement[]) => h("fieldset", {}, h("legend", {}, title), ...content);
  const element = h(
    "div",
    { class: "menu", id: "display", popover: "auto", "aria-label": "Display" },
    h("div", { class: "directions" }, ...directionButtons(actions.look)),
    group(
      "Show",
      grid,
      kept("axes", "Axes of the world", "x red, y green, z blue"),
      kept("wireframe", "Wireframe"),
      kept("orthographic", "Orthographic", "Parallel lines stay parallel"),
    ),
    group(
      "Light",
      kept("shadows", "Shadows", "Of a lamp on the left, behind the camera"),
      kept("occlusion", "Ambient occlusion", "Darkens corners and contacts; costs the most"),
    ),
    group("Points", h("div", { class: "points" }, points, pixels)),
    group("Page", h("label", { class: "field" }, "Background", backgrounds), dark, kept("shortcuts", "Single-key shortcuts", "Letters, digits, + and −")),
  );
  const button = h(
    "button",
    { popovertarget: "display", title: "Grid, axes, shadows, point size, background, theme", "aria-label": "Display", "aria-haspopup": "dialog" },
    icon("display"),
    h("span", { class: "label" }, "Display"),
  );
  element.addEventListener("beforetoggle", () => {
    const { left, bottom } = button.getBoundingClientRect();
    element.style.top = `${bottom + 6}px`;
    element.style.left = `${Math.max(6, Math.min(left, innerWidth - MENU_WIDTH))}px`;
  });
  element.addEventListener("toggle", (event) => button.setAttribute("aria-expanded", String((event as ToggleEvent).newState === "open")));
  const setGrid = (on: boolean) => {
    (grid.firstElementChild as HTMLInputElement).checked = on;
    actions.grid(on);
  };
  return { button, element, setGrid };
}
