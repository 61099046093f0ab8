// Handle between a panel and the view: drag it, or move it with the arrow keys, to set the panel's width. Twice: the default.

import { h } from "./dom";
import type { Side } from "./layout";
import { keep, kept } from "./options";

const MIN_PIXELS = 160;
/** Step of an arrow key, pixels. */
const STEP = 16;

export function splitter(layout: HTMLElement, side: Side, label: string): HTMLElement {
  const option = `${side}-width`;
  const panel = () => layout.querySelector<HTMLElement>(`.drawer.${side}`);
  const set = (pixels: number | null) => {
    const width = pixels && Math.round(Math.min(Math.max(pixels, MIN_PIXELS), 0.6 * innerWidth));
    layout.style.setProperty(`--${side}-width`, width ? `${width}px` : null);
    keep(option, width ? String(width) : "");
    handle.ariaValueNow = String(panel()?.offsetWidth ?? width);
  };
  const handle = h("div", {
    class: `splitter ${side}`,
    role: "separator",
    tabindex: 0,
    "aria-orientation": "vertical",
    "aria-label": label,
    title: "Drag to resize",
    ondblclick: () => set(null),
  });
  handle.addEventListener("pointerdown", (event) => handle.setPointerCapture(event.pointerId));
  handle.addEventListener("pointermove", ({ clientX, pointerId }) => {
    if (handle.hasPointerCapture(pointerId)) set(side === "left" ? clientX : innerWidth - clientX);
  });
  handle.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -STEP, ArrowRight: STEP }[event.key];
    if (!step) return;
    set((panel()?.offsetWidth ?? 0) + (side === "left" ? step : -step));
    event.preventDefault();
  });
  set(Number(kept(option)) || null);
  return handle;
}
