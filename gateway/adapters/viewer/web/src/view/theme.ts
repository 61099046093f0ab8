// Colours of the background, the grid and the stereo camera's frustum.

import type { Background, Theme } from "../options";

type BackgroundColors = Record<"background" | "grid" | "frustum", string>;

const BACKGROUND_COLORS: Record<Exclude<Background, "theme"> | Theme, BackgroundColors> = {
  light: { background: "#e9edf3", grid: "#c3cad6", frustum: "#6a1fd0" },
  dark: { background: "#20242c", grid: "#3a4250", frustum: "#c39bff" },
  white: { background: "#ffffff", grid: "#c9cfd9", frustum: "#6a1fd0" },
  black: { background: "#000000", grid: "#363d49", frustum: "#c39bff" },
  // The background of the images that the gateway renders.
  sky: { background: "#cce5ff", grid: "#a3bbd6", frustum: "#6a1fd0" },
};

export function backgroundColors(name: Background, theme: Theme): BackgroundColors {
  return BACKGROUND_COLORS[name === "theme" ? theme : name];
}

/** Return a background that a client has set, with colours that are visible on it. */
export function colorsOn(rgb: [number, number, number]): BackgroundColors {
  const [r, g, b] = rgb;
  const light = 0.2126 * r + 0.7152 * g + 0.0722 * b > 0.4;
  const css = (mix: (channel: number) => number) => `rgb(${rgb.map((channel) => Math.round(255 * mix(channel))).join(", ")})`;
  return {
    background: css((channel) => channel),
    grid: css((channel) => (light ? 0.8 * channel : 0.75 * channel + 0.25)),
    frustum: light ? "#6a1fd0" : "#c39bff",
  };
}
