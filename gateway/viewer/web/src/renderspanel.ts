// Panel of the last render requests: scene, image, duration or error.

import { h } from "./dom";
import type { Lightbox } from "./lightbox";
import type { Status } from "./protocol";

interface Render {
  id: number;
  when: number;
  status: number;
  milliseconds: number;
  queued: number;
  what: string;
  scene: string;
  image: boolean;
  error: string;
  warnings: string[];
}

export class RendersPanel {
  readonly element = h("section", { "aria-label": "Recent renders" });
  private readonly list = h("ul", { class: "renders" });
  private readonly note = h("p", { class: "empty", role: "status" }, "Waiting for the gateway …");
  /** Number of requests at the last download of the list; -1 before the first. */
  private last = -1;
  private known = 0;
  private active = false;

  constructor(private readonly lightbox: Lightbox) {
    this.element.append(this.note, this.list);
  }

  setActive(active: boolean): void {
    this.active = active;
    void this.refresh();
  }

  /** Called when the connection opens, perhaps to another gateway, whose count starts at zero. */
  connected(): void {
    this.last = -1;
  }

  /** Show the number of requests in a status message; download the list if it changed. */
  announce(status: Status): void {
    const { interfaces, renders } = status;
    this.known = renders ?? 0;
    if (this.known === 0) {
      const runs = !interfaces || "render" in interfaces;
      this.note.textContent = runs
        ? "No render requests yet. Drake's render clients post to /render."
        : "No render endpoint runs in this gateway.";
      this.note.hidden = false;
      this.list.replaceChildren();
    }
    void this.refresh();
  }

  private async refresh(): Promise<void> {
    const { known } = this;
    if (!this.active || known === 0 || known === this.last) return;
    this.last = known;
    const response = await fetch("view/renders").catch(() => null);
    if (!response?.ok) {
      this.last = -1; // the next status message downloads it again
      return;
    }
    const renders = (await response.json()) as Render[];
    this.note.hidden = true;
    this.list.replaceChildren(...renders.map((render) => this.item(render)));
  }

  private item(render: Render): HTMLElement {
    const time = new Date(render.when * 1000).toLocaleTimeString();
    const full = `view/renders/${render.id}.png`;
    const image = render.image
      ? h(
          "button",
          { class: "thumb", title: "In full size", onclick: () => this.lightbox.open(render.what, () => full, `render-${render.id}.png`) },
          h("img", { src: `${full}?width=192`, alt: render.what, loading: "lazy" }),
        )
      : h("div", { class: "none" }, String(render.status));
    const waited = render.queued >= 1 ? `, ${render.queued.toFixed(0)} ms of it waiting` : "";
    return h(
      "li",
      {},
      image,
      h(
        "div",
        {},
        h("div", { class: "what" }, render.what),
        h("div", { class: "quiet" }, `${time} · ${render.milliseconds.toFixed(1)} ms${waited}`),
        h("div", { class: render.error ? "problem" : "quiet" }, render.error || render.scene),
        ...render.warnings.map((warning) => h("div", { class: "warning" }, warning)),
      ),
    );
  }
}
