// Display settings of this browser, from the URL (?shadows=on), an earlier visit, or the default, in this order.

import { signal } from "@preact/signals";

const PREFIX = "scenegate.";

export type Theme = "light" | "dark";
/** Backgrounds with their names on the page. */
export const BACKGROUNDS = { theme: "By theme", white: "White", black: "Black", sky: "Sky" } as const;
export type Background = keyof typeof BACKGROUNDS;

/** A setting. `shown` is its current value, which a client may set, too; `choose` keeps it for the next visit. */
export class Option<T extends string> {
  readonly shown;
  /** Value of the visitor. */
  own: T;

  constructor(
    readonly name: string,
    allowed: readonly T[],
    fallback: T,
  ) {
    const wanted = [new URLSearchParams(location.search).get(name), kept(name)] as T[];
    this.own = wanted.find((value) => allowed.includes(value)) ?? fallback;
    this.shown = signal(this.own);
  }

  choose(value: T): void {
    this.shown.value = this.own = value;
    keep(this.name, value);
  }
}

export type Switch = Option<"off" | "on">;
const toggle = (name: string, fallback: "off" | "on"): Switch => new Option(name, ["off", "on"], fallback);

/** Name of the graphics device if it is the processor, or else null. */
export const softwareDevice: string | null = (() => {
  const context = typeof document === "undefined" ? null : document.createElement("canvas").getContext("webgl2");
  const name = String(context?.getParameter(context.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER) ?? "");
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.exec(name)?.[0] ?? null;
})();

const switches = {
  grid: toggle("grid", "on"),
  axes: toggle("axes", "on"),
  wireframe: toggle("wireframe", "off"),
  orthographic: toggle("orthographic", "off"),
  shadows: toggle("shadows", softwareDevice ? "off" : "on"),
  occlusion: toggle("occlusion", "off"),
  shortcuts: toggle("shortcuts", "on"),
};
export type SwitchName = keyof typeof switches;

export const options = {
  ...switches,
  background: new Option<Background>("background", Object.keys(BACKGROUNDS) as Background[], "theme"),
  theme: new Option<Theme>("theme", ["light", "dark"], matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"),
};

/** Store a value for the next visit. */
export function keep(name: string, value: string): void {
  try {
    localStorage.setItem(PREFIX + name, value);
  } catch {
    // The browser does not allow storage: the setting lasts as long as the page.
  }
}

/** Return a value that was stored by `keep`. */
export function kept(name: string): string | null {
  try {
    return localStorage.getItem(PREFIX + name);
  } catch {
    return null;
  }
}
