// The time that the page shows: the live scene or an earlier moment. The gateway plays; the page sends commands.

import { computed, signal } from "@preact/signals";
import type { TimeCommand, TimeState } from "../protocol";

/** Times before this are not times of day: simulations start at 0. */
const FIRST_DAY = 1e8;

export class Timeline {
  /** Null: the gateway keeps no earlier states. */
  readonly state = signal<TimeState | null>(null);
  readonly isLive = computed(() => (this.state.value?.mode ?? "live") === "live");
  /** Moment that the page shows; null: it is live or plays. */
  readonly moment = computed(() => (this.state.value?.mode === "paused" ? this.state.value.position : null));
  /** Moment to show when the gateway has sent its span: that of the address, or the state before a lost connection. */
  private wanted: Pick<TimeState, "position"> | TimeState | null = null;
  /** True when the gateway has sent its span on this connection. */
  private hasSpan = false;

  /** @param moved called when the page shows another moment, or none */
  constructor(
    private readonly send: (command: TimeCommand) => void,
    private readonly moved: () => void,
  ) {
    let shown = this.moment.peek();
    this.moment.subscribe((moment) => {
      if (moment !== shown) moved();
      shown = moment;
    });
  }

  receive(state: TimeState): void {
    const { wanted } = this;
    this.state.value = state;
    this.wanted = null;
    this.hasSpan = true;
    if (!wanted) return;
    if (!("mode" in wanted)) this.pause(wanted.position);
    else if (wanted.position >= state.first) {
      this.pause(wanted.position);
      this.send({ time: wanted.mode === "playing" ? "play" : "set", rate: wanted.rate, loop: wanted.loop });
    } // or else the gateway has begun another history, and the page is live
  }

  /** When connected again, go on where the page was. */
  restore(): void {
    const { value } = this.state;
    this.hasSpan = false;
    if (value && value.mode !== "live") this.wanted = value;
  }

  /** Called with each status. The gateway has sent its span before the first one, if it keeps earlier states. */
  settle(): void {
    if (this.hasSpan) return;
    this.state.value = this.wanted = null;
    this.moved();
  }

  /** Show the moment of the address. */
  open(at: number | null): void {
    if (at === null) return;
    if (this.state.peek()) this.pause(at);
    else this.wanted = { position: at };
  }

  pause(at: number): void {
    this.send({ time: "pause" });
    this.seek(at);
  }

  seek = (at: number): void => this.send({ time: "seek", at });
  /** Go some seconds on, or back, from where the gateway is: it may be ahead of the last message. */
  shift = (by: number): void => this.send({ time: "seek", by });
  live = (): void => this.send({ time: "live" });
  step = (steps: -1 | 1): void => this.send({ time: "step", steps });
  set = (settings: Pick<TimeCommand, "rate" | "loop">): void => this.send({ time: "set", ...settings });
  toggle = (): void => this.send({ time: this.state.peek()?.mode === "paused" ? "play" : "pause" });
}

/** Format seconds: `12.3 s`, `2:05.0`. */
export function duration(seconds: number): string {
  const tenths = Math.round(Math.abs(seconds) * 10);
  const [minutes, rest] = [Math.floor(tenths / 600), ((tenths % 600) / 10).toFixed(1)];
  return minutes ? `${minutes}:${rest.padStart(4, "0")}` : `${rest} s`;
}

/** Say which moment a state is: `12.3 s ago`, `0:12.0 of 2:05.0`. */
export function momentText({ mode, live, position, first, last }: TimeState): string {
  if (mode === "live") return "live";
  return live ? `${duration(last - position)} ago` : `${duration(position - first)} of ${duration(last - first)}`;
}

/** Return the time of the simulation, or else the time of day; empty if the times are not those of days. */
export function clockText({ position, first, simulation }: TimeState): string {
  if (simulation !== null) return `simulation ${simulation.toFixed(2)} s`;
  if (first < FIRST_DAY) return "";
  const date = new Date(position * 1000);
  return `${date.toLocaleTimeString([], { hourCycle: "h23" })}.${Math.floor(date.getMilliseconds() / 100)}`;
}
