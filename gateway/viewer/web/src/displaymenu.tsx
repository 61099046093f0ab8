// Menu of the display settings. It opens below its button in the toolbar.

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";
import { Button, Select, Slider } from "./controls";
import { BACKGROUNDS, type Background, options } from "./options";
import type { Direction } from "./stage";
import type { Viewer } from "./viewer";

/** Width of the menu with its margin, as in style.css, pixels. */
const MENU_WIDTH = 246;
const BACKGROUND_NAMES: Record<Background, string> = { theme: "By theme", white: "White", black: "Black", sky: "Sky" };
const DIRECTIONS: [Direction, string, string][] = [
  ["top", "Top", "From above (1)"],
  ["front", "Front", "From +X (2)"],
  ["side", "Side", "From −Y (3)"],
];
type Switch = "grid" | "axes" | "wireframe" | "orthographic" | "shadows" | "occlusion" | "shortcuts";

export function DirectionButtons({ look }: { look: (direction: Direction) => void }) {
  return (
    <div class="directions">
      {DIRECTIONS.map(([direction, text, title]) => (
        <button key={text} type="button" title={title} onClick={() => look(direction)}>
          {text}
        </button>
      ))}
    </div>
  );
}

function check(text: string, title: string, checked: boolean, choose: (on: boolean) => void) {
  return (
    <label key={text} class="check" title={title}>
      <input type="checkbox" checked={checked} onChange={({ currentTarget }) => choose(currentTarget.checked)} />
      {text}
    </label>
  );
}

function group(title: string, ...content: ComponentChildren[]) {
  return (
    <fieldset>
      <legend>{title}</legend>
      {content}
    </fieldset>
  );
}

export function DisplayMenu({ viewer }: { viewer: Viewer }) {
  const menu = useRef<HTMLDivElement>(null);
  const button = useRef<HTMLButtonElement>(null);
  const isOpen = useSignal(false);
  const pixels = useSignal(0);
  const { background, theme } = options;
  const kept = (name: Switch, text: string, title = "") =>
    check(text, title, options[name].shown.value === "on", (on) => options[name].choose(on ? "on" : "off"));
  const place = () => {
    const { left, bottom } = button.current!.getBoundingClientRect();
    menu.current!.style.top = `${bottom + 6}px`;
    menu.current!.style.left = `${Math.max(6, Math.min(left, innerWidth - MENU_WIDTH))}px`;
  };
  const setPoints = (value: number) => viewer.pointSize((pixels.value = value));
  const about = { title: "Grid, axes, shadows, point size, background, theme", popovertarget: "display", "aria-expanded": isOpen.value };
  const onToggle = ({ newState }: ToggleEvent) => (isOpen.value = newState === "open");
  const backgrounds = BACKGROUNDS.map((name): [Background, string] => [name, BACKGROUND_NAMES[name]]);
  return (
    <>
      <Button icon="display" ref={button} aria-label="Display" aria-haspopup="dialog" {...about}>
        <span class="label">Display</span>
      </Button>
      <div ref={menu} class="menu" id="display" popover="auto" role="group" aria-label="Display" onBeforeToggle={place} onToggle={onToggle}>
        <DirectionButtons look={viewer.look} />
        {group(
          "Show",
          kept("grid", "Grid on the ground"),
          kept("axes", "Axes of the world", "x red, y green, z blue"),
          kept("wireframe", "Wireframe"),
          kept("orthographic", "Orthographic", "Parallel lines stay parallel"),
        )}
        {group(
          "Light",
          kept("shadows", "Shadows", "Of a lamp on the left, behind the camera"),
          kept("occlusion", "Ambient occlusion", "Darkens corners and contacts; costs the most"),
        )}
        {group(
          "Points",
          <div class="points">
            <Slider label="Point size" title="Pixels; at the left end: as published" max={12} step={1} value={pixels.value} onInput={setPoints} />
            <output>{pixels.value ? `${pixels.value} px` : "as sent"}</output>
          </div>,
        )}
        {group(
          "Page",
          <label class="field">
            Background
            <Select label="Background" value={background.shown.value} choices={backgrounds} onChange={(name) => background.choose(name)} />
          </label>,
          check("Dark theme", "", theme.shown.value === "dark", (on) => theme.choose(on ? "dark" : "light")),
          kept("shortcuts", "Single-key shortcuts", "Letters, digits, + and −"),
        )}
      </div>
    </>
  );
}
