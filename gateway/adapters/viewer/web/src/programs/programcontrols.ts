// Controls of programs, their values and samples. Without a browser.

import { batch, type Signal, signal } from "@preact/signals";
import type { ControlChange, ControlDefinition, ControlValue, PageControls } from "../protocol";

/** Shortest time between two changes of a control that are sent, and between two images of a plot, ms. */
const INTERVAL = 40;
/** Number of samples that a plot keeps, as the gateway does. */
const MAX_SAMPLES = 2000;

export interface ProgramControl {
  /** `logarithmic`: the slider has equal steps for equal factors. Of the page's own controls. */
  readonly definition: ControlDefinition & { logarithmic?: boolean };
  readonly value: Signal<ControlValue>;
  /** Of a plot: time and values of each sample. */
  readonly samples: Signal<number[][]>;
}

/** A folder of the panel. */
export interface Folder {
  readonly controls: ProgramControl[];
  readonly folders: Map<string, Folder>;
}

export class ProgramControls {
  readonly all = signal<ProgramControl[]>([]);
  /** Number of updates of the scene: nodes of gizmos may have moved. */
  readonly updates = signal(0);
  private readonly byId = new Map<number, ProgramControl>();
  private lastNumber = 0;
  private receivedNumber = 0;
  /** Number of the last change of each control. Older values from the gateway are ignored. */
  private readonly sentNumbers = new Map<number, number>();
  /** Changes that wait until `INTERVAL` is over. */
  private readonly waiting = new Map<number, ControlValue>();
  private sendTimer: ReturnType<typeof setTimeout> | undefined;
  /** Samples that are shown when `INTERVAL` is over. */
  private readonly unshown = new Map<number, number[][]>();
  private showTimer: ReturnType<typeof setTimeout> | undefined;

  constructor(private readonly send: (change: ControlChange) => void) {}

  receive(message: PageControls): void {
    batch(() => {
      if (message.controls) this.setAll(message.controls);
      for (const [id, value] of message.values) this.setReceived(id, value);
    });
    for (const [id, samples] of message.samples) this.addSamples(id, samples);
  }

  private setAll(definitions: ControlDefinition[]): void {
    const controls = definitions.map((definition) => {
      const { value, samples } = this.byId.get(definition.id) ?? { value: signal(definition.value), samples: signal([]) };
      return { definition, value, samples };
    });
    this.byId.clear();
    for (const control of controls) this.byId.set(control.definition.id, control);
    for (const numbers of [this.sentNumbers, this.waiting, this.unshown]) {
      for (const id of [...numbers.keys()]) if (!this.byId.has(id)) numbers.delete(id);
    }
    this.all.value = controls;
  }

  private setReceived(id: number, value: ControlValue): void {
    const control = this.byId.get(id);
    const isOld = this.waiting.has(id) || (this.sentNumbers.get(id) ?? 0) > this.receivedNumber;
    if (control && !isOld) control.value.value = value;
  }

  private addSamples(id: number, numbers: Float64Array): void {
    const control = this.byId.get(id);
    if (!control) return;
    const columns = 1 + (control.definition.series?.length ?? 0);
    let rows = this.unshown.get(id) ?? [...control.samples.value];
    for (let at = 0; at < numbers.length; at += columns) {
      const row = [...numbers.subarray(at, at + columns)];
      if (Number(row[0]) < Number(rows.at(-1)?.[0])) rows = []; // the program has started again
      rows.push(row);
    }
    this.unshown.set(id, rows.slice(-MAX_SAMPLES));
    this.showTimer ??= setTimeout(() => this.showSamples(), INTERVAL);
  }

  private showSamples(): void {
    this.showTimer = undefined;
    batch(() => {
      for (const [id, rows] of this.unshown) {
        const control = this.byId.get(id);
        if (control) control.samples.value = rows;
      }
    });
    this.unshown.clear();
  }

  /** Note the number of the last change that the gateway has executed. */
  received(number: number): void {
    this.receivedNumber = number;
  }

  /** Forget all, for a new connection. */
  reset(): void {
    this.sentNumbers.clear();
    this.waiting.clear();
    this.setAll([]);
  }

  /**
   * Change a value; of a button, report a click, which the gateway counts. While a value changes often, some in between are not
   * sent.
   */
  set(control: ProgramControl, value: ControlValue): void {
    const { id, type } = control.definition;
    if (type === "button") {
      this.lastNumber += 1;
      this.send({ control: id, number: this.lastNumber, value: null });
      return;
    }
    control.value.value = value;
    this.waiting.set(id, value);
    if (this.sendTimer === undefined) this.flush();
  }

  private flush(): void {
    this.sendTimer = undefined;
    if (!this.waiting.size) return;
    for (const [id, value] of this.waiting) {
      this.lastNumber += 1;
      this.sentNumbers.set(id, this.lastNumber);
      this.send({ control: id, number: this.lastNumber, value });
    }
    this.waiting.clear();
    this.sendTimer = setTimeout(() => this.flush(), INTERVAL);
  }
}

/** Return the controls in their folders, in order of first appearance. */
export function foldersOf(controls: ProgramControl[]): Folder {
  const root: Folder = { controls: [], folders: new Map() };
  for (const control of controls) {
    let folder = root;
    for (const name of control.definition.path.slice(0, -1)) {
      const next: Folder = folder.folders.get(String(name)) ?? { controls: [], folders: new Map() };
      folder.folders.set(String(name), next);
      folder = next;
    }
    folder.controls.push(control);
  }
  return root;
}
