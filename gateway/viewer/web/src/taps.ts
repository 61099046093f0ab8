// Clicks and taps on the view, not drags.

export type Button = "left" | "middle" | "right";
/** Buttons by their number in MouseEvent.button. */
const BUTTONS: readonly Button[] = ["left", "middle", "right"];
/** Distance from which a movement between press and release is a drag, pixels. */
const DRAG_PIXELS = 5;

/** Call back with the place on the page. Enter is a tap in the middle. */
export function onTap(canvas: HTMLElement, tapped: (x: number, y: number, button: Button) => void): void {
  let press = { x: 0, y: 0 };
  canvas.addEventListener("pointerdown", (event) => (press = { x: event.clientX, y: event.clientY }));
  const released = (event: MouseEvent) => {
    const button = BUTTONS[event.button];
    const isDrag = Math.hypot(event.clientX - press.x, event.clientY - press.y) > DRAG_PIXELS;
    if (button && !isDrag) tapped(event.clientX, event.clientY, button);
  };
  canvas.addEventListener("click", released);
  canvas.addEventListener("auxclick", released);
  canvas.addEventListener("keydown", ({ key }) => {
    const { left, top, width, height } = canvas.getBoundingClientRect();
    if (key === "Enter") tapped(left + width / 2, top + height / 2, "left");
  });
}
