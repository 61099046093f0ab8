// Colormaps of point clouds: a few stops each, interpolated linearly.

type Stops = readonly (readonly [number, number, number])[];

/** Stops at equal distances, 0 to 255; viridis and turbo as they are published. */
export const COLOR_MAPS = {
  turbo: [
    [48, 18, 59], [70, 107, 227], [41, 187, 236], [49, 242, 153], [164, 252, 60], [237, 208, 58], [251, 128, 34], [210, 49, 5], [122, 4, 3],
  ],
  viridis: [
    [68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99], [170, 220, 50], [253, 231, 37],
  ],
  grey: [
    [20, 20, 20], [250, 250, 250],
  ],
  "blue–red": [
    [59, 76, 192], [221, 221, 221], [180, 4, 38],
  ],
} as const satisfies Record<string, Stops>;

export type MapName = keyof typeof COLOR_MAPS;

export interface Range {
  low: number;
  high: number;
}

/** Return the range of the finite values; 0 to 1 if there are none. */
export function rangeOf(values: Float32Array, offset: number, stride: number): Range {
  let low = Infinity;
  let high = -Infinity;
  for (let i = offset; i < values.length; i += stride) {
    const value = values[i] ?? NaN;
    if (value < low && value > -Infinity) low = value;
    if (value > high && value < Infinity) high = value;
  }
  return low <= high ? { low, high } : { low: 0, high: 1 };
}

/** Return RGBA bytes for every value; NaN is grey. */
export function colorize(values: Float32Array, offset: number, stride: number, range: Range, map: MapName): Uint8Array {
  const stops: Stops = COLOR_MAPS[map];
  const table = new Uint8Array(256 * 3);
  for (let i = 0; i < 256; i++) {
    const at = (i / 255) * (stops.length - 1);
    const k = Math.min(Math.floor(at), stops.length - 2);
    for (let c = 0; c < 3; c++) {
      const [from, to] = [stops[k]?.[c] ?? 0, stops[k + 1]?.[c] ?? 0];
      table[3 * i + c] = Math.round(from + (at - k) * (to - from));
    }
  }
  const count = Math.floor((values.length - offset + stride - 1) / stride);
  const colors = new Uint8Array(4 * count);
  const scale = range.high > range.low ? 255 / (range.high - range.low) : 0;
  for (let i = 0; i < count; i++) {
    const value = values[offset + i * stride] ?? NaN;
    const index = 3 * Math.max(0, Math.min(255, Math.round((value - range.low) * scale)));
    for (let c = 0; c < 3; c++) colors[4 * i + c] = Number.isNaN(value) ? 128 : (table[index + c] ?? 0);
    colors[4 * i + 3] = 255;
  }
  return colors;
}

/** Return a colormap as a CSS background. */
export function ramp(map: MapName): string {
  return `linear-gradient(90deg, ${COLOR_MAPS[map].map((c) => `rgb(${c.join(" ")})`).join(", ")})`;
}
