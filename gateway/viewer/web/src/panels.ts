// Which panels are open. On small screens they are drawers over the view, one open at a time.

import { batch, signal } from "@preact/signals";
import type { FullImage } from "./lightbox";

export type Side = "left" | "right";
export const TABS = ["Selection", "Controls", "Stereo", "Renders"] as const;
export type Tab = (typeof TABS)[number];
const NARROW = matchMedia("(max-width: 899px)");

export class Panels {
  readonly left = signal(false);
  readonly right = signal(false);
  readonly tab = signal<Tab>("Stereo");
  /** Image that is shown in full size. */
  readonly full = signal<FullImage | null>(null);

  /** The tree is open if the screen has room for it, also after it was resized. */
  constructor() {
    const adapt = () => {
      this.left.value = !NARROW.matches;
      this.right.value = false;
    };
    NARROW.addEventListener("change", adapt);
    adapt();
  }

  /** Show a panel on the right if the screen has room for it. */
  show(tab: Tab): void {
    this.tab.value = tab;
    if (!NARROW.matches) this.right.value = true;
  }

  toggle(side: Side): void {
    const open = !this[side].value;
    batch(() => {
      if (open && NARROW.matches) this.closeDrawers();
      this[side].value = open;
    });
  }

  /** Close drawers over the view; return true if one was open. */
  closeDrawers(): boolean {
    if (!NARROW.matches || !(this.left.value || this.right.value)) return false;
    this.left.value = this.right.value = false;
    return true;
  }

  isActive(tab: Tab): boolean {
    return this.right.value && this.tab.value === tab;
  }
}
