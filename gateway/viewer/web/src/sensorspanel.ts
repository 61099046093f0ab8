// What the stereo camera sees now, and its parameters. Asks for pictures only while somebody looks at them.

import { h } from "./dom";
import type { Lightbox } from "./lightbox";
import { Parameters } from "./parameters";

const PICTURES = { left: "Left", right: "Right", disparity: "Disparity", confidence: "Confidence" } as const;
type Name = keyof typeof PICTURES;
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
  /** Whether the parameters were asked for since the panel came into sight. */
  private asked = false;
  private looking = false;
  private timer = 0;

  constructor(private readonly lightbox: Lightbox) {
    for (const name of Object.keys(PICTURES) as Name[]) this.addThumb(name);
    this.thumbs.hidden = true;
    this.element.append(this.note, this.thumbs, this.parameters.element);
    lightbox.element.addEventListener("close", () => (this.full = null));
    document.addEventListener("visibilitychange", () => this.poll());
  }

  /** Whether the panel is in sight. */
  setActive(active: boolean): void {
    if (active && !this.active) this.asked = false;
    this.active = active;
    this.poll();
  }

  /** The gateway is there, maybe another one than before: nothing of the last one's counts. */
  connected(): void {
    this.number = 0;
    this.asked = false;
    this.poll();
  }

  private addThumb(name: Name): void {
    const title = PICTURES[name];
    const image = h("img", { alt: `${title} picture of the stereo camera` });
    const caption = h("span");
    const button = h("button", { class: "thumb", title: `${title} in full size`, onclick: () => this.open(name) }, image);
    button.dataset.picture = name;
    this.images.set(name, image);
    this.captions.set(name, caption);
    this.thumbs.append(h("figure", {}, button, h("figcaption", {}, h("span", {}, title), caption)));
  }

  private open(name: Name): void {
    this.full = name;
    this.poll();
    const source = () => `/view/sensor/${name}.jpg?frame=${this.number}`;
    this.lightbox.open(`${PICTURES[name]}, stereo camera`, source, `${name}.jpg`);
  }

  private poll(): void {
    clearTimeout(this.timer);
    if (!this.looking && (this.active || this.full) && document.visibilityState === "visible") void this.look();
  }

  private async look(): Promise<void> {
    this.looking = true;
    try {
      const answer = await fetch("/view/sensor");
      if (answer.status === 200) {
        await this.take((await answer.json()) as SensorState);
        this.say("", true);
        if (this.active && !this.asked) {
          this.asked = true;
          void this.parameters.load();
        }
      } else if (answer.status === 204) this.say("No stereo camera runs in this gateway.", false);
      else this.say(await answer.text(), false);
    } catch {
      this.say(this.thumbs.hidden ? "The gateway does not answer." : "The gateway does not answer; these are its last pictures.");
    }
    this.looking = false;
    this.timer = setTimeout(() => this.poll(), PERIOD);
  }

  /** One sentence above the pictures, or instead of them. */
  private say(text: string, shown = !this.thumbs.hidden): void {
    this.note.textContent = text;
    this.note.hidden = text === "";
    this.thumbs.hidden = this.parameters.element.hidden = !shown;
  }

  private async take(state: SensorState): Promise<void> {
    for (const [name, caption] of this.captions) caption.textContent = state.captions[name] ?? "";
    if (state.number === this.number) return;
    this.number = state.number;
    const loading = [...this.images].map(([name, image]) => load(image, `/view/sensor/${name}.jpg?width=320&frame=${state.number}`));
    if (this.full && this.lightbox.isOpen) this.lightbox.refresh();
    await Promise.allSettled(loading);
  }
}

function load(image: HTMLImageElement, source: string): Promise<void> {
  image.src = source;
  return image.decode();
}
