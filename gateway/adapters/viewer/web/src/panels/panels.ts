// Which panels are open. On small screens they are drawers over the view, one open at a time.

import { batch, computed, effect, signal } from "@preact/signals";
import type { ProgramControls } from "../programs/programcontrols";
import type { Status } from "../protocol";
import type { Session } from "../session";

export type Side = "left" | "right";
export const TABS = ["Selection", "Controls", "Stereo", "Renders"] as const;
export type Tab = (typeof TABS)[number];
/** Tabs that are there while they are used. Controls are, while a program has any. */
const IS_USED: Partial<Record<Tab, (status: Status) => boolean>> = {
  Stereo: ({ interfaces = {} }) => "stereo" in interfaces,
  Renders: ({ renders = 0 }) => renders > 0,
};
const NARROW = matchMedia("(max-width: 899px)");

export interface FullImage {
  title: string;
  /** URL; of a live image another one for each of its frames. */
  source: () => string;
  fileName: string;
}

export class Panels {
  readonly left = signal(false);
  readonly right = signal(false);
  /** Tab that was chosen; the first one is shown while there is no such tab. */
  readonly tab = signal<Tab>("Stereo");
  readonly tabs = signal<Tab[]>(["Selection"]);
  private used: Tab[] = ["Selection", "Controls"];
  readonly shown = computed(() => (this.tabs.value.includes(this.tab.value) ? this.tab.value : TABS[0]));
  /** Image that is shown in full size. */
  readonly full = signal<FullImage | null>(null);

  /** The tree is open if the screen has room for it, also after it was resized. */
  constructor({ status }: Session, controls: Pick<ProgramControls, "all">) {
    effect(() => {
      const { value } = status;
      if (value) this.used = TABS.filter((tab) => IS_USED[tab]?.(value) ?? true);
      const tabs = this.used.filter((tab) => tab !== "Controls" || controls.all.value.length > 0);
      if (String(tabs) !== String(this.tabs.peek())) this.tabs.value = tabs;
    });
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

  open = (image: FullImage | null): void => void (this.full.value = image);

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
    return this.right.value && this.shown.value === tab;
  }
}
