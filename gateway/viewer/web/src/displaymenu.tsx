// Menu of the display settings. It opens below its button in the toolbar.

import { useSignal } from "@preact/signals";
import type { ComponentChildren } from "preact";
import { useRef } from "preact/hooks";
import { Button, Select } from "./controls";
import type { PointSize } from "./materials";
import { BACKGROUNDS, type Background, options } from "./options";
import { cameraName } from "./sideviews";
import type { Viewer } from "./viewer";

/** Width of the menu with its margin, as in style.css, pixels. */
const MENU_WIDTH = 246;
const BACKGROUND_NAMES: Record<Background, string> = { theme: "By theme", white: "White", black: "Black", sky: "Sky" };
const UNITS: [PointSize["unit"], string][] = [
  ["sent", "As published"],
  ["pixels", "Pixels"],
  ["metres", "Metres"],
];
const FIRST_SIZES = { sent: 2, pixels: 2, metres: 0.02 };
type Switch = "grid" | "axes" | "wireframe" | "orthographic" | "shadows" | "occlusion" | "shortcuts";

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
  const points = useSignal<PointSize>({ size: 2, unit: "sent" });
  const { background, theme } = options;
  const kept = (name: Switch, text: string, title = "") =>
    check(text, title, options[name].shown.value === "on", (on) => options[name].choose(on ? "on" : "off"));
  const place = () => {
    const { left, bottom } = button.current!.getBoundingClientRect();
    menu.current!.style.top = `${bottom + 6}px`;
    menu.current!.style.left = `${Math.max(6, Math.min(left, innerWidth - MENU_WIDTH))}px`;
  };
  const setPoints = (size: PointSize) => viewer.pointSize((points.value = size));
  const { size, unit } = points.value;
  const { session, sideCamera } = viewer;
  const { value: selected } = session.selected;
  const cameras = new Map([["", "None"]]);
  if (session.status.value?.interfaces?.stereo) cameras.set("stereo", "Stereo camera");
  const ofNode = selected ? `path:${JSON.stringify(selected.path)}` : "";
  for (const camera of [sideCamera.value, ofNode]) if (camera && !cameras.has(camera)) cameras.set(camera, cameraName(camera));
  const about = { title: "Grid, axes, shadows, point size, background, theme", popovertarget: "display", "aria-expanded": isOpen.value };
  const onToggle = ({ newState }: ToggleEvent) => (isOpen.value = newState === "open");
  const backgrounds = BACKGROUNDS.map((name): [Background, string] => [name, BACKGROUND_NAMES[name]]);
  return (
    <>
      <Button icon="display" ref={button} aria-label="Display" aria-haspopup="dialog" {...about}>
        <span class="label">Display</span>
      </Button>
      <div ref={menu} class="menu" id="display" popover="auto" role="group" aria-label="Display" onBeforeToggle={place} onToggle={onToggle}>
        {group(
          "Show",
          kept("grid", "Grid on the ground"),
          kept("axes", "Axes of the world", "x red, y green, z blue"),
          kept("wireframe", "Wireframe"),
          kept("orthographic", "Orthographic", "Parallel lines stay parallel"),
        )}
        {group(
          "Beside the view",
          viewer.stage.renderer &&
            check("From above", "Around the target of the view", viewer.hasTopView.value, (on) => (viewer.hasTopView.value = on)),
          <label class="field">
            Image of
            <Select label="Image of" value={viewer.sideCamera.value} choices={[...cameras]} onChange={(camera) => (sideCamera.value = camera)} />
          </label>,
        )}
        {group(
          "Light",
          kept("shadows", "Shadows", "Of a lamp on the left, behind the camera"),
          kept("occlusion", "Ambient occlusion", "Darkens corners and contacts; costs the most"),
        )}
        {group(
          "Points",
          <div class="points">
            <Select label="Point size" value={unit} choices={UNITS} onChange={(chosen) => setPoints({ unit: chosen, size: FIRST_SIZES[chosen] })} />
            <input
              type="number"
              aria-label="Size of points"
              min={0}
              step="any"
              disabled={unit === "sent"}
              value={size}
              onInput={({ currentTarget }) => setPoints({ unit, size: Math.max(0, Number(currentTarget.value)) })}
            />
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
