// The time that the page shows: the live scene or an earlier moment. The gateway plays; the page sends commands.

import { computed, signal } from "@preact/signals";

/** Seconds since the epoch. */
type Time = number;

export interface TimeState {
  kind: "time";
  mode: "live" | "playing" | "paused";
  /** True if the end of the span is the live scene; false: a log. */
  live: boolean;
  /** Seconds of the scene in a second. */
  rate: number;
  loop: boolean;
  /** True while the gateway looks for a state. */
  working: boolean;
  /** Why there is no state; empty: there is. */
  problem: string;
  /** Time of the simulation in a log, seconds; null: none is known. */
  simulation: number | null;
  position: Time;
  first: Time;
  last: Time;
}

export interface TimeCommand {
  time: "live" | "play" | "pause" | "seek" | "step" | "set";
  at?: Time;
  steps?: -1 | 1;
  rate?: number;
  loop?: boolean;
}

/** Times before this are not times of day: simulations start at 0. */
const FIRST_DAY: Time = 1e8;

export class Timeline {
  /** Null: the gateway keeps no earlier states. */
  readonly state = signal<TimeState | null>(null);
  /** Moment that the page shows; null: it is live or plays. */
  readonly moment = computed(() => (this.state.value?.mode === "paused" ? this.state.value.position : null));
  /** Moment of the address, until the gateway shows it. */
  private wanted: Time | null = null;

  /** @param moved called when the page shows another moment, or none */
  constructor(
    private readonly send: (command: TimeCommand) => void,
    moved: () => void,
  ) {
    this.moment.subscribe(moved);
  }

  receive(state: TimeState): void {
    this.state.value = state;
    if (this.wanted === null) return;
    const at = this.wanted;
    this.wanted = null;
    this.pause(at);
  }

  /** After a lost connection, go on where the page was. */
  restore(): void {
    const { value } = this.state;
    if (!value || value.mode === "live") return;
    const { position: at, rate, loop } = value;
    this.pause(at);
    this.send({ time: value.mode === "playing" ? "play" : "set", rate, loop });
  }

  /** Show the moment of the address. */
  open(at: Time | null): void {
    if (at === null) return;
    if (this.state.peek()) this.pause(at);
    else this.wanted = at;
  }

  pause(at: Time): void {
    this.send({ time: "pause" });
    this.seek(at);
  }

  seek = (at: Time): void => this.send({ time: "seek", at });
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
