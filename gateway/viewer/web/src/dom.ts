// Small helpers for building the page.

type Attributes = Record<string, string | number | boolean | ((event: Event) => void)>;

/** Create an element with attributes (functions for "onclick" and other events) and children. */
export function h<K extends keyof HTMLElementTagNameMap>(
  tag: K,
  attributes: Attributes = {},
  ...children: (Node | string)[]
): HTMLElementTagNameMap[K] {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (typeof value === "boolean") element.toggleAttribute(name, value);
    else element.setAttribute(name, String(value));
  }
  element.append(...children);
  return element;
}

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
export function pathText(path: (string | number)[]): string {
  return path.length ? path.map((name) => (typeof name === "number" ? `#${name}` : name || '""')).join(" / ") : "scene";
}
