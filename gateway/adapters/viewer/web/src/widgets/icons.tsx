// Line icons on a 16 x 16 grid.

const PATHS = {
  tree: "M2 3h5M5 8h6M5 13h6M3 3v10h2M3 8h2",
  fit: "M2 6V2h4M10 2h4v4M14 10v4h-4M6 14H2v-4",
  home: "M2 8l6-5.5L14 8M4 7v6.5h8V7",
  cube: "M8 1.8l5.5 3v6.4L8 14.2l-5.5-3V4.8zM2.5 4.8L8 8l5.5-3.2M8 8v6.2",
  snapshot: "M2 5h3l1-1.8h4L11 5h3v8H2zM8 9m-2.4 0a2.4 2.4 0 1 0 4.8 0a2.4 2.4 0 1 0-4.8 0",
  film: "M2 3.5h12v9H2zM5 3.5v9M11 3.5v9M2 6.5h3M2 9.5h3M11 6.5h3M11 9.5h3",
  render: "M2 3h12v10H2zM2 11l3.5-4 3 3 2-2 3.5 3M10.7 5.6h.1",
  download: "M8 2v8M4.8 7L8 10.2 11.2 7M2.5 13.5h11",
  share: "M4 1.5h5.5L12.5 4.5v10H4zM9 1.5V5h3.5M8.2 7v5M6 9.8l2.2 2.2 2.2-2.2",
  close: "M4 4l8 8M12 4l-8 8",
  chevron: "M6 3.5L10.5 8 6 12.5",
  eye: "M1.5 8S4 3.8 8 3.8 14.5 8 14.5 8 12 12.2 8 12.2 1.5 8 1.5 8zM8 8m-1.9 0a1.9 1.9 0 1 0 3.8 0a1.9 1.9 0 1 0-3.8 0",
  hidden: "M1.5 8S4 3.8 8 3.8 14.5 8 14.5 8 12 12.2 8 12.2 1.5 8 1.5 8zM3 13.5l10-11",
  display:
    "M2 4.5h5M11 4.5h3M9 4.5m-1.8 0a1.8 1.8 0 1 0 3.6 0a1.8 1.8 0 1 0-3.6 0M2 11.5h3M9 11.5h5M7 11.5m-1.8 0a1.8 1.8 0 1 0 3.6 0a1.8 1.8 0 1 0-3.6 0",
  panel: "M2 2.5h12v11H2zM10 2.5v11",
  follow: "M2 4.5h7.5v7H2zM9.5 7.2L14 5v6L9.5 8.8",
  measure: "M1.5 10.5l9-9 4 4-9 9zM4.2 7.8l1.7 1.7M6.9 5.1l2.3 2.3M9.6 2.4l1.7 1.7",
  play: "M4.5 3l8 5-8 5z",
  pause: "M5 3v10M11 3v10",
  step: "M4 3l6 5-6 5zM12 3v10",
  stepback: "M12 3L6 8l6 5zM4 3v10",
  loop: "M3 8V5h9M10 3l2 2-2 2M13 8v3H4M6 13l-2-2 2-2",
  copy: "M5.5 5.5h8v8h-8zM3.5 10.5h-1v-8h8v1",
} as const;

export type IconName = keyof typeof PATHS;

/** @param title what the icon says without a text beside it */
export function Icon({ name, title }: { name: IconName; title?: string }) {
  return (
    <svg viewBox="0 0 16 16" class="icon" role={title ? "img" : undefined} aria-label={title} aria-hidden={!title}>
      <path d={PATHS[name]} />
    </svg>
  );
}
