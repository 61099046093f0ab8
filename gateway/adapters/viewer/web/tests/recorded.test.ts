// Recordings: parsing, and the updates that lead to the state at a time.

import { expect, it, vi } from "vitest";
import { Model } from "../src/model";
import type { SceneUpdate, TimeState } from "../src/protocol";
import { Playback } from "../src/recorded/playback";
import { inflate, Player, readRecording, type Step } from "../src/recorded/recording";
import { addressOf, channelPath, imagePath } from "../src/resources";
import { update } from "./scene";

/** Return a frame of gateway/adapters/viewer/frames.py whose body is bytes. */
function frameOf(header: object, body: number[] = []): Uint8Array {
  const json = new TextEncoder().encode(JSON.stringify(header));
  const size = Math.ceil((8 + json.length) / 8) * 8 - 8;
  const frame = new Uint8Array(8 + size + body.length).fill(32);
  new DataView(frame.buffer).setUint32(0, 0x31564753, true);
  new DataView(frame.buffer).setUint32(4, size, true);
  frame.set(json, 8);
  frame.set(body, 8 + size);
  return frame;
}

function recordingOf(frames: [number, Uint8Array][]): ArrayBuffer {
  const sizes = frames.map(([, { length }]) => 16 + Math.ceil(length / 8) * 8);
  const bytes = new Uint8Array(sizes.reduce((a, b) => a + b, 0));
  let at = 0;
  frames.forEach(([time, frame], i) => {
    new DataView(bytes.buffer).setFloat64(at, time, true);
    new DataView(bytes.buffer).setUint32(at + 8, frame.length, true);
    bytes.set(frame, at + 16);
    at += sizes[i]!;
  });
  return bytes.buffer;
}

it("reads steps, the whole scene at some of them, and resources", async () => {
  vi.stubGlobal("URL", Object.assign(URL, { createObjectURL: (blob: Blob) => `blob:${blob.type}:${blob.size}` }));
  const recording = readRecording(
    recordingOf([
      [5, frameOf({ kind: "page", background: null, grid: null, home: null, clickable: [] })],
      [5, frameOf({ kind: "image", id: 3, data: [0, 5] }, [1, 2, 3, 4, 5])],
      [5, frameOf({ kind: "channel", id: 4, name: "a b", data: [0, 4] }, [1, 2, 3, 4])],
      [5, frameOf({ kind: "mesh", id: 4, topology: 1, position: [0, 0] })],
      [5, frameOf({ kind: "update", from: 0, revision: 1 })],
      [6.5, frameOf({ kind: "update", from: 1, revision: 2 })],
      [6.5, frameOf({ kind: "update", from: 0, revision: 2 })],
      [7, frameOf({ kind: "update", from: 2, revision: 3 })],
      [9, frameOf({ kind: "end" })],
    ]),
  );
  expect(recording.messages.map(({ kind }) => kind)).toEqual(["page", "mesh"]);
  expect(recording.steps.map(({ time, update, whole }) => [time, update.from, whole?.from])).toEqual([
    [5, 0, 0],
    [6.5, 1, 0],
    [7, 2, undefined],
  ]);
  expect(recording.end).toBe(9);
  expect(addressOf(imagePath(3))).toBe("blob::5");
  expect(addressOf(channelPath(4, "a b"))).toBe("blob::4");
  expect(addressOf(imagePath(9))).toBe("view/image/9");
});

it("decodes base64 and gzip", async () => {
  const text = "H4sIAAAAAAAC/8tIzcnJBwCGphA2BQAAAA=="; // gzip of "hello"
  expect(new TextDecoder().decode(await inflate(text))).toBe("hello");
  await expect(inflate("AAAA")).rejects.toThrow();
});

/** Return ten steps: node 1 is at x = number of the step, and node 2 is there at odd ones. The whole scene is at steps 0, 4 and 8. */
function tenSteps(): Step[] {
  return Array.from({ length: 10 }, (_, i) => {
    const added = [{ id: 1, parent: 0, name: "robot" }];
    const odd = i % 2 ? [{ id: 2, parent: 0, name: "odd" }] : [];
    const pose = { 1: [i, 0, 0, 1, 0, 0, 0] as [number, number, number, number, number, number, number] };
    const step = update(i + 1, i ? odd : added, pose, i % 2 || !i ? [] : [2]);
    const whole = i % 4 ? null : { ...update(i + 1, [...added, ...odd], pose), from: 0 };
    return { time: 100 + i, update: step, whole };
  });
}

it("shows the state of any time, by few updates", () => {
  const model = new Model();
  const applied: SceneUpdate[] = [];
  const player = new Player(tenSteps(), (each) => {
    if (each.from !== 0) expect(each.from).toBe(model.revision);
    model.apply(each);
    applied.push(each);
  });
  for (const [time, updates] of [
    [0, 1],
    [100.5, 0],
    [101, 1],
    [102.9, 1],
    [106, 3],
    [105, 2],
    [105, 0],
    [109, 2],
    [1000, 0],
    [101, 2],
    [103, 2],
  ] as const) {
    const before = applied.length;
    player.show(time);
    const step = Math.min(9, Math.max(0, Math.floor(time) - 100));
    expect(model.find(["robot"])?.world.elements[12], `${time}`).toBe(step);
    expect(model.find(["odd"]) !== null).toBe(step % 2 === 1);
    expect([...model.nodes.values()].length).toBe(2 + (step % 2));
    expect(applied.length - before, `${time}`).toBe(updates);
  }
});

it("plays, seeks, steps and loops as the gateway does", () => {
  const model = new Model();
  const states: TimeState[] = [];
  const playback = new Playback({ steps: tenSteps(), end: 110 }, 50, (each) => {
    if (each.kind === "update") model.apply(each);
    else states.push(each);
  });
  const x = () => model.find(["robot"])?.world.elements[12];
  const last = () => states.at(-1)!;
  expect([x(), states.length]).toEqual([0, 0]);
  playback.tick(50);
  expect(last()).toEqual({
    kind: "time",
    mode: "playing",
    live: false,
    rate: 1,
    loop: false,
    working: false,
    problem: "",
    simulation: null,
    position: 100,
    first: 100,
    last: 110,
  });
  playback.tick(52.5);
  expect([x(), last().position]).toEqual([2, 102.5]);
  playback.execute({ time: "set", rate: 2 }, 53);
  playback.tick(54);
  expect([x(), last().position]).toEqual([5, 105]);
  playback.execute({ time: "seek", at: 101.2 }, 54);
  playback.tick(54.5);
  expect([x(), last().mode, last().position]).toEqual([2, "playing", 102.2]);
  playback.execute({ time: "pause" }, 54.5);
  playback.tick(60);
  expect([x(), last().mode, last().position]).toEqual([2, "paused", 102.2]);
  playback.execute({ time: "step", steps: 1 }, 60);
  expect([x(), last().position]).toEqual([3, 103]);
  playback.execute({ time: "step", steps: -1 }, 60);
  playback.execute({ time: "step", steps: -1 }, 60);
  expect([x(), last().position]).toEqual([1, 101]);
  playback.execute({ time: "seek", by: 3 }, 60);
  playback.execute({ time: "seek", by: -1.5 }, 60);
  expect([x(), last().position]).toEqual([2, 102.5]);
  playback.execute({ time: "seek", at: 1e9 }, 61);
  expect([x(), last().mode, last().position]).toEqual([9, "paused", 110]);
  playback.execute({ time: "play" }, 61);
  expect([x(), last().mode, last().position]).toEqual([0, "playing", 100]);
  playback.tick(70);
  expect([x(), last().mode, last().position]).toEqual([9, "paused", 110]);
  playback.execute({ time: "play", loop: true }, 70);
  playback.tick(75.1);
  playback.tick(76.1);
  expect([x(), last().mode, last().position]).toEqual([2, "playing", 102]);
  playback.execute({ time: "live" }, 76.1);
  expect(last().mode).toBe("playing");
});

it("has no time bar for a scene at rest", () => {
  const kinds: string[] = [];
  const playback = new Playback({ steps: tenSteps().slice(0, 1), end: 100 }, 0, ({ kind }) => void kinds.push(kind));
  playback.tick(1);
  expect(kinds).toEqual(["update"]);
});
