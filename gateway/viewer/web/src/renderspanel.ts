// The last render requests: what came in, what went out, how long it took, or why not.

import { h } from "./dom";
import type { Lightbox } from "./lightbox";

interface Render {
  id: number;
  when: number;
  status: number;
  milliseconds: number;
  queued: number;
  what: string;
  scene: string;
  picture: boolean;
  error: string;
}

export class RendersPanel {
  readonly element = h("section", { "aria-label": "Recent renders" });
  private readonly list = h("ul", { class: "renders" });
  private readonly empty = h("p", { class: "empty" }, "No render request has come yet. POST /render answers Drake's render clients.");
  private last = -1;
  private known = 0;
  private active = false;

  constructor(private readonly lightbox: Lightbox) {
    this.element.append(this.empty, this.list);
  }

  setActive(active: boolean): void {
    this.active = active;
    void this.refresh();
  }

  /** The gateway has answered this many requests so far. */
  announce(count: number): void {
    this.known = count;
    void this.refresh();
  }

  private async refresh(): Promise<void> {
    if (!this.active || this.known === this.last) return;
    this.last = this.known;
    const answer = await fetch("/view/renders").catch(() => null);
    if (!answer?.ok) return;
    const renders = (await answer.json()) as Render[];
    this.empty.hidden = renders.length > 0;
    this.list.replaceChildren(...renders.map((render) => this.item(render)));
  }

  private item(render: Render): HTMLElement {
    const time = new Date(render.when * 1000).toLocaleTimeString();
    const full = `/view/renders/${render.id}.png`;
    const picture = render.picture
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
      picture,
      h(
        "div",
        {},
        h("div", { class: "what" }, render.what),
        h("div", { class: "quiet" }, `${time} · ${render.milliseconds.toFixed(1)} ms${waited}`),
        h("div", { class: render.error ? "problem" : "quiet" }, render.error || render.scene),
      ),
    );
  }
}
