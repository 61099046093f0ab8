// Tabs; arrow keys move between them.

import { h } from "./dom";

/** The row of tabs. Each tab controls the element with the id that `controls` returns. */
export class TabList {
  readonly element = h("div", { class: "tabs", role: "tablist" });
  private readonly buttons = new Map<string, HTMLElement>();

  constructor(
    names: string[],
    controls: (name: string) => string,
    private readonly onSelect: (name: string) => void,
  ) {
    for (const name of names) {
      const button = h("button", { role: "tab", "aria-controls": controls(name), onclick: () => onSelect(name) }, name);
      this.buttons.set(name, button);
      this.element.append(button);
    }
    this.element.addEventListener("keydown", (event) => this.key(event));
  }

  select(name: string): void {
    for (const [each, button] of this.buttons) {
      button.setAttribute("aria-selected", String(each === name));
      button.tabIndex = each === name ? 0 : -1;
    }
  }

  private key(event: KeyboardEvent): void {
    const buttons = [...this.buttons];
    const current = buttons.findIndex(([, button]) => button === event.target);
    const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    const next = buttons[(current + step + buttons.length) % buttons.length];
    if (!step || !next) return;
    this.onSelect(next[0]);
    next[1].focus();
    event.preventDefault();
  }
}

/** The panels on the right, of which one is shown. */
export class Tabs {
  readonly element: HTMLElement;
  private readonly list: TabList;
  private readonly pages = new Map<string, HTMLElement>();
  current = "";

  constructor(
    pages: Record<string, HTMLElement>,
    private readonly onShow: (name: string) => void,
  ) {
    const id = (name: string) => `page-${name.toLowerCase().replaceAll(" ", "-")}`;
    this.list = new TabList(Object.keys(pages), id, (name) => this.show(name));
    this.element = h("aside", { class: "drawer right", "aria-label": "Panels" }, this.list.element);
    for (const [name, content] of Object.entries(pages)) {
      const page = h("div", { class: "page", role: "tabpanel", id: id(name), "aria-label": name, tabindex: -1 }, content);
      this.pages.set(name, page);
      this.element.append(page);
    }
  }

  show(name: string): void {
    this.current = name;
    this.list.select(name);
    for (const [each, page] of this.pages) page.hidden = each !== name;
    this.onShow(name);
  }
}
