// The time of a recording: what gateway/adapters/viewer/playback.py is for a page with a gateway. It has the same commands and messages.

import type { SceneUpdate, TimeCommand, TimeState } from "../protocol";
import { Player, type Recording } from "./recording";

export class Playback {
  private mode: "playing" | "paused" = "playing";
  private rate = 1;
  private loop = false;
  /** Position at `startTime`. */
  private start: number;
  private startTime: number;
  private readonly player: Player;
  private readonly first: number;
  private readonly last: number;

  /**
   * @param now seconds of any clock
   * @param send called with updates of the scene, and with the state of the time bar
   */
  constructor(
    recording: Pick<Recording, "steps" | "end">,
    now: number,
    private readonly send: (message: SceneUpdate | TimeState) => void,
  ) {
    this.player = new Player(recording.steps, send);
    this.first = this.start = recording.steps[0]!.time;
    this.last = Math.max(recording.end, this.first);
    this.startTime = now;
    this.player.show(this.first);
  }

  execute({ time, at = 0, by, steps = 1, rate, loop }: TimeCommand, now: number): void {
    let position = this.position(now);
    this.rate = rate ?? this.rate;
    this.loop = loop ?? this.loop;
    if (time === "play") {
      this.mode = "playing";
      if (position >= this.last) position = this.first;
    } else if (time === "pause") this.mode = "paused";
    else if (time === "seek") position = by === undefined ? at : position + by;
    else if (time === "step") {
      this.mode = "paused";
      position = this.player.timeOf(position, steps);
    }
    this.start = position;
    this.startTime = now;
    this.show(now);
  }

  /** Go on, if it plays. Called for each image. */
  tick(now: number): void {
    if (this.mode === "playing" && this.last > this.first) this.show(now);
  }

  private position(now: number): number {
    const position = this.mode === "playing" ? this.start + (now - this.startTime) * this.rate : this.start;
    return Math.min(Math.max(position, this.first), this.last);
  }

  private show(now: number): void {
    let position = this.position(now);
    if (this.mode === "playing" && position >= this.last) {
      if (this.loop) position = this.first;
      else this.mode = "paused";
      this.start = position;
      this.startTime = now;
    }
    this.player.show(position);
    this.report(now);
  }

  private report(now: number): void {
    const { mode, rate, loop, first, last } = this;
    this.send({
      kind: "time",
      mode,
      live: false,
      rate,
      loop,
      working: false,
      problem: "",
      simulation: null,
      position: this.position(now),
      first,
      last,
    });
  }
}
