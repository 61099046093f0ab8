// Recordings: the frames of a scene over time, in one block (gateway/replay/page_recorder.py).

import { parse } from "../connection";
import type { Message, RecordedChannel, RecordedImage, RecordingEnd, SceneUpdate } from "../protocol";
import { channelPath, imagePath, keepResource } from "../resources";

/** Bytes before the frame of a record: time (float64), size of the frame (uint32), 0. */
const PREFIX_BYTES = 16;

/** A change of the scene. */
export interface Step {
  /** Seconds since the epoch. */
  time: number;
  /** The differences to the step before. */
  update: SceneUpdate;
  /** The whole scene; null: no update in the recording has it. */
  whole: SceneUpdate | null;
}

export interface Recording {
  /** What a page needs before the first step: its settings and all meshes. */
  messages: Message[];
  steps: Step[];
  /** Time until which the last step is valid, seconds since the epoch. */
  end: number;
}

type Recorded = Message | RecordedImage | RecordedChannel | RecordingEnd;

/** Decode base64 and gzip. */
export async function inflate(base64: string): Promise<ArrayBuffer> {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

/** Parse a recording, and keep its textures and channels for `addressOf`. */
export function readRecording(buffer: ArrayBuffer): Recording {
  const recording: Recording = { messages: [], steps: [], end: 0 };
  const view = new DataView(buffer);
  for (let at = 0; at < buffer.byteLength; ) {
    const time = view.getFloat64(at, true);
    const start = at + PREFIX_BYTES;
    const size = view.getUint32(at + 8, true);
    add(recording, time, parse(buffer.slice(start, start + size)) as Recorded);
    at = start + 8 * Math.ceil(size / 8);
  }
  return recording;
}

function add(recording: Recording, time: number, message: Recorded): void {
  const { steps } = recording;
  const last = steps[steps.length - 1];
  recording.end = time;
  if (message.kind === "update") {
    const whole = message.from === 0 ? message : null;
    if (last && last.update.revision === message.revision) last.whole = whole;
    else steps.push({ time, update: message, whole });
  } else if (message.kind === "image") keepResource(imagePath(message.id), message.data);
  else if (message.kind === "channel") keepResource(channelPath(message.id, message.name), message.data);
  else if (message.kind !== "end") recording.messages.push(message);
}

/** Applies the updates that lead to the state at a time. */
export class Player {
  /** Index of the last step that was applied. */
  private current = -1;

  constructor(
    private readonly steps: Step[],
    private readonly apply: (update: SceneUpdate) => void,
  ) {}

  /** Show the state at a time, seconds since the epoch. */
  show(time: number): void {
    const { steps } = this;
    const target = lastAt(steps, time);
    let whole = target;
    while (!steps[whole]!.whole) whole -= 1;
    if (target < this.current || whole > this.current + 1) {
      this.apply(steps[whole]!.whole!);
      this.current = whole;
    }
    while (this.current < target) this.apply(steps[(this.current += 1)]!.update);
  }

  /** Return the time of the step that is a number of steps after that of a time. */
  timeOf(time: number, steps: number): number {
    const index = lastAt(this.steps, time) + steps;
    return this.steps[Math.min(Math.max(index, 0), this.steps.length - 1)]!.time;
  }
}

/** Return the index of the last step at or before a time; 0 if there is none. */
function lastAt(steps: Step[], time: number): number {
  let [low, high] = [0, steps.length - 1];
  while (low < high) {
    const middle = Math.ceil((low + high) / 2);
    if (steps[middle]!.time <= time) low = middle;
    else high = middle - 1;
  }
  return low;
}
