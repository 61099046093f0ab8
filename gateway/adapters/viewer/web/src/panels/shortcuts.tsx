// Keys of the page, and the menu that lists them with the mouse actions.

import { useRef } from "preact/hooks";
import { options, type SwitchName } from "../options";
import { snapshot } from "../tools/downloads";
import { placeStereo } from "../tools/stereopose";
import type { Viewer } from "../viewer";
import type { Panels } from "./panels";

interface Shortcut {
  /** Values of `KeyboardEvent.key`; the first one is listed. */
  keys: [string, ...string[]];
  text: string;
  run: () => unknown;
}

const MENU_ID = "keys";
const MOUSE: [string, string][] = [
  ["Drag", "Turn"],
  ["Right drag, arrows", "Pan"],
  ["Wheel", "Zoom to the pointer"],
  ["Click, Enter", "Select what is there"],
  ["Double click in the tree", "Fit that path"],
];

const togglePopover = (id: string) => document.getElementById(id)?.togglePopover();
const flip = (name: SwitchName) => options[name].choose(options[name].shown.peek() === "on" ? "off" : "on");

function shortcuts(viewer: Viewer, panels: Panels): Shortcut[] {
  const { timeline, measurement, session } = viewer;
  const zoom = (factor: number) => viewer.stage.rig.controls.dollyIn(factor);
  return [
    { keys: ["f"], text: "Fit the selection, or everything", run: () => viewer.fit() },
    { keys: ["h"], text: "Home view", run: () => viewer.look("home") },
    { keys: ["1"], text: "From above", run: () => viewer.look("top") },
    { keys: ["2"], text: "From the front (+X)", run: () => viewer.look("front") },
    { keys: ["3"], text: "From the side (−Y)", run: () => viewer.look("side") },
    { keys: ["+", "="], text: "Zoom in", run: () => zoom(0.8) },
    { keys: ["-"], text: "Zoom out", run: () => zoom(1.25) },
    { keys: ["c"], text: "Follow the selection, ride along, stop", run: () => viewer.follow.cycle(session.selected.peek()) },
    { keys: ["m"], text: "Measure between two points", run: () => measurement.toggle() },
    { keys: ["p"], text: "Pause, play", run: () => timeline.toggle() },
    { keys: ["l"], text: "Go live", run: () => timeline.live() },
    { keys: [","], text: "One change back", run: () => timeline.step(-1) },
    { keys: ["."], text: "One change forward", run: () => timeline.step(1) },
    { keys: ["g"], text: "Grid", run: () => flip("grid") },
    { keys: ["a"], text: "Axes of the world", run: () => flip("axes") },
    { keys: ["w"], text: "Wireframe", run: () => flip("wireframe") },
    { keys: ["o"], text: "Orthographic", run: () => flip("orthographic") },
    { keys: ["b"], text: "From above, beside the view", run: () => (viewer.topView.isShown.value = !viewer.topView.isShown.value) },
    { keys: ["d"], text: "Display menu", run: () => togglePopover("display") },
    { keys: ["i"], text: "This view as PNG", run: () => snapshot(viewer) },
    { keys: ["r"], text: "Start a film, end it", run: () => viewer.film.toggle() },
    { keys: ["v"], text: "Place the stereo camera at this view", run: () => placeStereo(viewer).then(() => panels.show("Stereo")) },
    { keys: ["t"], text: "Scene tree", run: () => panels.toggle("left") },
    { keys: ["s"], text: "Panels", run: () => panels.toggle("right") },
    { keys: ["?"], text: "This list", run: () => togglePopover(MENU_ID) },
    { keys: ["Escape"], text: "Close, stop measuring, deselect", run: () => panels.closeDrawers() || measurement.stop() || viewer.select(null) },
  ];
}

/** Return whether an element takes typed text. Sliders, check boxes, colours and menus do not: keys are shortcuts there. */
function takesText(target: EventTarget | null): boolean {
  if (target instanceof HTMLInputElement) return !["range", "checkbox", "radio", "color", "button"].includes(target.type);
  return target instanceof HTMLTextAreaElement;
}

/** Run shortcuts wherever no text is typed. Escape leaves a text. */
export function listenForShortcuts(viewer: Viewer, panels: Panels): void {
  const actions = new Map(shortcuts(viewer, panels).flatMap(({ keys, run }) => keys.map((key) => [key, run] as const)));
  addEventListener("keydown", (event) => {
    const { key, target } = event;
    if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || panels.full.value) return;
    if (key === "Escape" && document.querySelector(":popover-open")) return; // it closes the menu
    if (takesText(target)) {
      if (key === "Escape") (target as HTMLElement).blur();
      return;
    }
    // Assistive programs type single characters by mistake: they can be switched off where the view does not have the focus.
    const isCharacter = key.length === 1;
    if (isCharacter && options.shortcuts.shown.value === "off" && target !== viewer.stage.canvas) return;
    const run = actions.get(isCharacter ? key.toLowerCase() : key);
    if (!run) return;
    if (target instanceof HTMLSelectElement) event.preventDefault(); // else it would choose the entry with this letter
    run();
  });
}

export function ShortcutList({ viewer, panels }: { viewer: Viewer; panels: Panels }) {
  const list = useRef(shortcuts(viewer, panels)).current;
  const row = (keys: string, text: string) => (
    <tr key={text}>
      <th scope="row">{keys}</th>
      <td>{text}</td>
    </tr>
  );
  return (
    <div class="menu keys" id={MENU_ID} popover="auto" role="group" aria-label="Keys and mouse">
      <table>
        {MOUSE.map(([action, text]) => row(action, text))}
        {list.map(({ keys, text }) => row(keys[0].length === 1 ? keys[0].toUpperCase() : "Esc", text))}
      </table>
    </div>
  );
}
