// Plot of a program: curves over the last seconds, with their newest values.

import { short } from "../format";
import type { ProgramControl } from "./programcontrols";

const WIDTH = 320;
const HEIGHT = 110;

export function PlotView({ control: { definition, samples } }: { control: ProgramControl }) {
  const { path, series = [], seconds = 30, unit } = definition;
  const end = samples.value.at(-1)?.[0] ?? 0;
  const rows = samples.value.filter(([time]) => Number(time) >= end - seconds);
  const [low, high] = limits(rows);
  const newest = rows.at(-1) ?? [];
  const values = series.map((_, curve) => withUnit(newest[1 + curve], unit));
  const description = series.map((name, curve) => `${name} ${values[curve]}`).join(", ");
  const title = String(path.at(-1));
  return (
    <figure class="plot">
      <figcaption>{title}</figcaption>
      <div class="plot-area">
        <span class="plot-limit">{short(high)}</span>
        <svg viewBox={`0 0 ${WIDTH} ${HEIGHT}`} preserveAspectRatio="none" role="img" aria-label={`${title}: ${description}`}>
          {series.map((name, curve) => (
            <path key={name} style={`--curve: var(--curve-${curve})`} d={curvePath(rows, 1 + curve, end - seconds, seconds, low, high)} />
          ))}
        </svg>
        <span class="plot-limit">{short(low)}</span>
      </div>
      <p class="plot-time">
        <span>−{short(seconds)} s</span>
        <span>now</span>
      </p>
      <ul>
        {series.map((name, curve) => (
          <li key={name} style={`--curve: var(--curve-${curve})`}>
            {name}
            <output>{values[curve]}</output>
          </li>
        ))}
      </ul>
    </figure>
  );
}

function withUnit(value: number | undefined, unit = ""): string {
  return value === undefined || Number.isNaN(value) ? "–" : `${short(value)} ${unit}`.trim();
}

/** Return the lowest and the highest value, apart from each other. */
export function limits(rows: number[][]): [number, number] {
  let [low, high] = [Infinity, -Infinity];
  for (const [, ...values] of rows) {
    for (const value of values) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  if (low > high) return [0, 1];
  const margin = low === high ? Math.abs(low) * 0.1 || 1 : 0;
  return [low - margin, high + margin];
}

/** Return the SVG path of a column of samples. NaN makes a gap. */
export function curvePath(rows: number[][], column: number, start: number, seconds: number, low: number, high: number): string {
  let path = "";
  let command = "M";
  for (const row of rows) {
    const value = row[column] ?? Number.NaN;
    if (Number.isNaN(value)) {
      command = "M";
      continue;
    }
    const x = ((Number(row[0]) - start) / seconds) * WIDTH;
    const y = HEIGHT * (1 - (value - low) / (high - low));
    path += `${command}${x.toFixed(1)} ${y.toFixed(1)}`;
    command = "L";
  }
  return path;
}
