// Light or dark, and what is behind the scene: as the address says (?theme=dark&background=sky), else as the computer
// is set.

export type Theme = "light" | "dark";

/** What is behind the scene, and the grid and the stereo camera's frustum before it. */
export interface Ground {
  background: string;
  grid: string;
  frustum: string;
}

const GROUNDS = {
  white: { background: "#ffffff", grid: "#c9cfd9", frustum: "#6a1fd0" },
  black: { background: "#000000", grid: "#363d49", frustum: "#c39bff" },
  // The colour of the gateway's own pictures where nothing is.
  sky: { background: "#cce5ff", grid: "#a3bbd6", frustum: "#6a1fd0" },
} as const satisfies Record<string, Ground>;

export type Background = "theme" | keyof typeof GROUNDS;
export const BACKGROUNDS: readonly Background[] = ["theme", "white", "black", "sky"];

export function startingBackground(): Background {
  const asked = new URLSearchParams(location.search).get("background");
  return BACKGROUNDS.find((name) => name === asked) ?? "theme";
}

export function ground(name: Background): Ground {
  if (name !== "theme") return GROUNDS[name];
  const css = getComputedStyle(document.documentElement);
  const color = (variable: string) => css.getPropertyValue(variable).trim();
  return { background: color("--stage"), grid: color("--grid"), frustum: color("--frustum") };
}

export function startingTheme(): Theme {
  const asked = new URLSearchParams(location.search).get("theme");
  if (asked === "light" || asked === "dark") return asked;
  return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}
