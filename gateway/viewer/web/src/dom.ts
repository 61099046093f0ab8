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

/** A number for people: four significant digits. */
export function short(value: number): string {
  return Number.isFinite(value) ? String(Number(value.toPrecision(4))) : String(value);
}

/** A path element or path as text; numbers and strings stay apart. */
export function pathText(path: (string | number)[]): string {
  return path.length ? path.map((name) => (typeof name === "number" ? `#${name}` : name || '""')).join(" / ") : "scene";
}
