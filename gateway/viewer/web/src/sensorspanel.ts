// Panel of the stereo camera: its current images and parameters. Requests images only while it is visible.

import { h } from "./dom";
import type { Lightbox } from "./lightbox";
import { Parameters } from "./parameters";

const IMAGES = { left: "Left", right: "Right", disparity: "Disparity", confidence: "Confidence" } as const;
type Name = keyof typeof IMAGES;
const PERIOD = 500;

interface SensorState {
  number: number;
  captions: Partial<Record<Name, string>>;
}

export class SensorsPanel {
  readonly element = h("section", { class: "sensors", "aria-label": "Stereo camera" });
  private readonly images = new Map<Name, HTMLImageElement>();
  private readonly captions = new Map<Name, HTMLElement>();
  private readonly note = h("p", { class: "empty", role: "status" }, "Waiting for the gateway …");
  private readonly thumbs = h("div", { class: "thumbs" });
  private readonly parameters = new Parameters();
  private number = 0;
  private full: Name | null = null;
  private active = false;
  /** True if the parameters were requested since the panel became visible. */
  private parametersRequested = false;
  private requesting = false;
  private timer = 0;

  constructor(private readonly lightbox: Lightbox) {
    for (const name of Object.keys(IMAGES) as Name[]) this.addThumb(name);
    this.thumbs.hidden = true;
    this.element.append(this.note, this.thumbs, this.parameters.element);
    lightbox.element.addEventListener("close", () => (this.full = null));
    document.addEventListener("visibilitychange", () => this.poll());
  }

  /** Start or stop requesting images. */
  setActive(active: boolean): void {
    if (active && !this.active) this.parametersRequested = false;
    this.active = active;
    this.poll();
  }

  /** Called when the connection opens, perhaps to another gateway: drop everything of the last one. */
  connected(): void {
    this.number = 0;
    this.parametersRequested = false;
    this.poll();
  }

  private addThumb(name: Name): void {
    const title = IMAGES[name];
    const image = h("img", { alt: `${title} image of the stereo camera` });
    const caption = h("span");
    const button = h("button", { class: "thumb", title: `${title} in full size`, onclick: () => this.open(name) }, image);
    button.dataset.image = name;
    this.images.set(name, image);
    this.captions.set(name, caption);
    this.thumbs.append(h("figure", {}, button, h("figcaption", {}, h("span", {}, title), caption)));
  }

  private open(name: Name): void {
    this.full = name;
    this.poll();
    const source = () => `view/sensor/${name}.jpg?frame=${this.number}`;
    this.lightbox.open(`${IMAGES[name]}, stereo camera`, source, `${name}.jpg`);
  }

  private poll(): void {
    clearTimeout(this.timer);
    if (!this.requesting && (this.active || this.full) && document.visibilityState === "visible") void this.request();
  }

  private async request(): Promise<void> {
    this.requesting = true;
    try {
      const response = await fetch("view/sensor");
      if (response.status === 200) {
        await this.show((await response.json()) as SensorState);
        this.say("", true);
        if (this.active && !this.parametersRequested) {
          this.parametersRequested = true;
          void this.parameters.load();
        }
      } else if (response.status === 204) this.say("No stereo camera runs in this gateway.", false);
      else this.say(await response.text(), false);
    } catch {
      this.say(this.thumbs.hidden ? "The gateway does not respond." : "The gateway does not respond; these are its last images.");
    }
    this.requesting = false;
    this.timer = setTimeout(() => this.poll(), PERIOD);
  }

  /** Show a message above the images, or instead of them. */
  private say(text: string, shown = !this.thumbs.hidden): void {
    this.note.textContent = text;
    this.note.hidden = text === "";
    this.thumbs.hidden = this.parameters.element.hidden = !shown;
  }

  private async show(state: SensorState): Promise<void> {
    for (const [name, caption] of this.captions) caption.textContent = state.captions[name] ?? "";
    if (state.number === this.number) return;
    this.number = state.number;
    const loading = [...this.images].map(([name, image]) => load(image, `view/sensor/${name}.jpg?width=320&frame=${state.number}`));
    if (this.full && this.lightbox.isOpen) this.lightbox.refresh();
    await Promise.allSettled(loading);
  }
}

function load(image: HTMLImageElement, source: string): Promise<void> {
  image.src = source;
  return image.decode();
}
