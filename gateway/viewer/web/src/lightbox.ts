// Dialog with an image in full size.

import { h } from "./dom";
import { icon } from "./icons";

export class Lightbox {
  private readonly title = h("h2");
  private readonly image = h("img", { alt: "" });
  private readonly save = h("a", { class: "button", title: "Save the image" }, icon("download"));
  private source: () => string = () => "";
  readonly element: HTMLDialogElement;

  constructor() {
    const close = h("button", { "aria-label": "Close", title: "Close (Esc)", onclick: () => this.element.close() }, icon("close"));
    this.element = h("dialog", { "aria-label": "Image" }, h("header", {}, this.title, this.save, close), this.image);
    this.element.addEventListener("click", (event) => {
      if (event.target === this.element) this.element.close();
    });
    this.element.addEventListener("close", () => this.image.removeAttribute("src"));
  }

  /** Show the image at the URL that `source` returns; a live image has a new URL at every `refresh`. */
  open(title: string, source: () => string, fileName: string): void {
    this.title.textContent = title;
    this.image.alt = title;
    this.source = source;
    this.save.download = fileName;
    this.refresh();
    this.element.showModal();
  }

  refresh(): void {
    this.image.src = this.save.href = this.source();
  }

  get isOpen(): boolean {
    return this.element.open;
  }
}
