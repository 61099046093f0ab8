// Tabs of a panel; arrow keys move between them.

import { h } from "./dom";

export class Tabs {
  readonly element: HTMLElement;
  private readonly buttons = new Map<string, HTMLElement>();
  private readonly pages = new Map<string, HTMLElement>();
  current = "";

  constructor(
    pages: Record<string, HTMLElement>,
    private readonly onShow: (name: string) => void,
  ) {
    const list = h("div", { class: "tabs", role: "tablist" });
    this.element = h("div", { class: "drawer right" }, list);
    for (const [name, content] of Object.entries(pages)) {
      const id = `page-${name.toLowerCase().replaceAll(" ", "-")}`;
      const button = h("button", { role: "tab", "aria-controls": id, onclick: () => this.show(name) }, name);
      const page = h("div", { class: "page", role: "tabpanel", id, "aria-label": name, tabindex: -1 }, content);
      this.buttons.set(name, button);
      this.pages.set(name, page);
      list.append(button);
      this.element.append(page);
    }
    list.addEventListener("keydown", (event) => this.key(event));
  }

  show(name: string): void {
    this.current = name;
    for (const [each, button] of this.buttons) {
      button.setAttribute("aria-selected", String(each === name));
      button.tabIndex = each === name ? 0 : -1;
    }
    for (const [each, page] of this.pages) page.hidden = each !== name;
    this.onShow(name);
  }

  private key(event: KeyboardEvent): void {
    const names = [...this.buttons.keys()];
    const step = event.key === "ArrowRight" ? 1 : event.key === "ArrowLeft" ? -1 : 0;
    const next = names[(names.indexOf(this.current) + step + names.length) % names.length];
    if (!step || !next) return;
    this.show(next);
    this.buttons.get(next)?.focus();
    event.preventDefault();
  }
}
