// Line icons on a 16 x 16 grid.

const PATHS = {
  tree: "M2 3h5M5 8h6M5 13h6M3 3v10h2M3 8h2",
  sensor: "M2 4.5h12v7H2zM5.5 8m-1.6 0a1.6 1.6 0 1 0 3.2 0a1.6 1.6 0 1 0-3.2 0M10.5 8m-1.6 0a1.6 1.6 0 1 0 3.2 0a1.6 1.6 0 1 0-3.2 0",
  fit: "M2 6V2h4M10 2h4v4M14 10v4h-4M6 14H2v-4",
  home: "M2 8l6-5.5L14 8M4 7v6.5h8V7",
  cube: "M8 1.8l5.5 3v6.4L8 14.2l-5.5-3V4.8zM2.5 4.8L8 8l5.5-3.2M8 8v6.2",
  grid: "M2 2h12v12H2zM2 6h12M2 10h12M6 2v12M10 2v12",
  axes: "M6 10V2M6 10l8 2M6 10l-4 4M4.5 3.5L6 2l1.5 1.5M12.5 10.2l1.5 1.8-2 1.2",
  wire: "M8 2l6.5 11h-13zM8 2v11M4.7 7.5h6.6M4.7 7.5L8 13l3.3-5.5",
  theme: "M8 2.5a5.5 5.5 0 1 0 0 11zM8 2.5a5.5 5.5 0 0 1 0 11",
  snapshot: "M2 5h3l1-1.8h4L11 5h3v8H2zM8 9m-2.4 0a2.4 2.4 0 1 0 4.8 0a2.4 2.4 0 1 0-4.8 0",
  download: "M8 2v8M4.8 7L8 10.2 11.2 7M2.5 13.5h11",
  close: "M4 4l8 8M12 4l-8 8",
  chevron: "M6 3.5L10.5 8 6 12.5",
  eye: "M1.5 8S4 3.8 8 3.8 14.5 8 14.5 8 12 12.2 8 12.2 1.5 8 1.5 8zM8 8m-1.9 0a1.9 1.9 0 1 0 3.8 0a1.9 1.9 0 1 0-3.8 0",
  hidden: "M1.5 8S4 3.8 8 3.8 14.5 8 14.5 8 12 12.2 8 12.2 1.5 8 1.5 8zM3 13.5l10-11",
  ortho: "M3 5h7v8H3zM3 5l3-2.5h7L10 5M13 2.5V10l-3 3",
} as const;

export type Icon = keyof typeof PATHS;

export function icon(name: Icon): SVGSVGElement {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", PATHS[name]);
  svg.append(path);
  return svg;
}
