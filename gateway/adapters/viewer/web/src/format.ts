// Numbers, lists and paths as text.

import type { Path } from "./protocol";

/** Format a number with four significant digits, and at least three decimals from 1000; an integer with all digits. */
export function short(value: number): string {
  if (!Number.isFinite(value) || Number.isInteger(value)) return String(value);
  return String(Number(Math.abs(value) < 1000 ? value.toPrecision(4) : value.toFixed(3)));
}

/** Format numbers in a row; up to a millionth of `scale` (default: the largest) is shown as 0. */
export function shortRow(values: number[], scale = Math.max(...values.map(Math.abs))): string {
  return values.map((value) => short(Math.abs(value) <= 1e-6 * scale ? 0 : value)).join("  ");
}

/** Return each text once, in order of first appearance, with its number of occurrences: `cylinder ×2`. */
export function counted(texts: string[]): string[] {
  const counts = new Map<string, number>();
  for (const text of texts) counts.set(text, (counts.get(text) ?? 0) + 1);
  return [...counts].map(([text, count]) => (count > 1 ? `${text} ×${count}` : text));
}

/** Format a path; the number 3 is `#3`, the string is `3`. */
export function pathText(path: Path): string {
  return path.length ? path.map((name) => (typeof name === "number" ? `#${name}` : name || '""')).join(" / ") : "scene";
}
