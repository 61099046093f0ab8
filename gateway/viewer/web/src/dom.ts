// Small helpers for building the page.

type Attributes = Record<string, string | number | boolean | ((event: Event) => void)>;

/** An element with attributes ("onclick" and the like take functions) and children. */
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

/** A number for people: four significant digits, whole numbers with all of theirs. */
export function short(value: number): string {
  return Number.isFinite(value) && !Number.isInteger(value) ? String(Number(value.toPrecision(4))) : String(value);
}

/** Numbers that belong together; what is a millionth of `scale` (by default of the largest) or less is 0. */
export function shortRow(values: number[], scale = Math.max(...values.map(Math.abs))): string {
  return values.map((value) => short(Math.abs(value) <= 1e-6 * scale ? 0 : value)).join("  ");
}

/** Each text once, in order of first appearance, with how often it is there: `cylinder ×2`. */
export function counted(texts: string[]): string[] {
  const counts = new Map<string, number>();
  for (const text of texts) counts.set(text, (counts.get(text) ?? 0) + 1);
  return [...counts].map(([text, count]) => (count > 1 ? `${text} ×${count}` : text));
}

/** A path element or path as text; numbers and strings stay apart. */
export function pathText(path: (string | number)[]): string {
  return path.length ? path.map((name) => (typeof name === "number" ? `#${name}` : name || '""')).join(" / ") : "scene";
}
