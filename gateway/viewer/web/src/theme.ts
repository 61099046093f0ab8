// Light or dark: as the address says (?theme=dark), else as the computer is set.

export type Theme = "light" | "dark";

export function startingTheme(): Theme {
  const asked = new URLSearchParams(location.search).get("theme");
  if (asked === "light" || asked === "dark") return asked;
  return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}
