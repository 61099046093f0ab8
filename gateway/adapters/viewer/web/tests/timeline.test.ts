import { expect, it } from "vitest";
import type { TimeCommand, TimeState } from "../src/protocol";
import { parseAddress } from "../src/tools/address";
import { clockText, duration, momentText, Timeline } from "../src/tools/timeline";

const STATE: TimeState = {
  kind: "time",
  mode: "paused",
  live: true,
  rate: 2,
  loop: true,
  working: false,
  problem: "",
  simulation: null,
  position: 1_700_000_047.66,
  first: 1_700_000_000,
  last: 1_700_000_060,
};

function connected(state: TimeState): [Timeline, TimeCommand[]] {
  const sent: TimeCommand[] = [];
  const timeline = new Timeline(
    (command) => sent.push(command),
    () => undefined,
  );
  timeline.receive(state);
  return [timeline, sent];
}

it("says which moment is shown", () => {
  expect([0.04, 12.34, 59.96, 125].map(duration)).toEqual(["0.0 s", "12.3 s", "1:00.0", "2:05.0"]);
  expect(momentText(STATE)).toBe("12.3 s ago");
  expect(momentText({ ...STATE, live: false })).toBe("47.7 s of 1:00.0");
  expect(clockText(STATE)).toMatch(/^\d\d:\d\d:\d\d\.6$/);
  expect(clockText({ ...STATE, first: 0, position: 3 })).toBe("");
  expect(clockText({ ...STATE, simulation: 1.5 })).toBe("simulation 1.50 s");
});

it("shows the moment of the address once the gateway has a timeline", () => {
  const { time, camera } = parseAddress("&time=1700000012.500000", 1);
  expect([time, camera, parseAddress("&time=x", 1).time]).toEqual([1_700_000_012.5, null, null]);
  const sent: TimeCommand[] = [];
  const timeline = new Timeline(
    (command) => sent.push(command),
    () => undefined,
  );
  timeline.open(time);
  expect(sent).toEqual([]);
  timeline.receive({ ...STATE, mode: "live" });
  timeline.receive({ ...STATE, mode: "live" });
  expect(sent).toEqual([{ time: "pause" }, { time: "seek", at: 1_700_000_012.5 }]);
});

it("goes on where it was after a lost connection", () => {
  for (const [mode, time] of [
    ["paused", "set"],
    ["playing", "play"],
  ] as const) {
    const [timeline, sent] = connected({ ...STATE, mode });
    timeline.restore();
    expect(sent).toEqual([]);
    timeline.receive({ ...STATE, mode: "live" });
    timeline.settle();
    expect(sent).toEqual([{ time: "pause" }, { time: "seek", at: STATE.position }, { time, rate: 2, loop: true }]);
  }
  const [timeline, sent] = connected({ ...STATE, mode: "live" });
  timeline.restore();
  timeline.receive({ ...STATE, mode: "live" });
  expect(sent).toEqual([]);
});

it("is live if the gateway comes back with another history, or without one", () => {
  const [timeline, sent] = connected(STATE);
  timeline.restore();
  timeline.receive({ ...STATE, mode: "live", first: STATE.position + 1, last: STATE.position + 2 });
  timeline.settle();
  expect([sent, timeline.isLive.value]).toEqual([[], true]);
  timeline.receive(STATE);
  timeline.restore();
  timeline.settle();
  expect([timeline.state.value, timeline.moment.value, timeline.isLive.value]).toEqual([null, null, true]);
});

it("has no moment of the address if the gateway keeps no earlier states", () => {
  let moved = 0;
  const timeline = new Timeline(
    () => undefined,
    () => (moved += 1),
  );
  timeline.open(12);
  const before = moved;
  timeline.settle();
  expect(moved).toBe(before + 1);
});

it("has a moment only while it is paused", () => {
  const [timeline] = connected(STATE);
  expect(timeline.moment.value).toBe(STATE.position);
  timeline.receive({ ...STATE, mode: "playing" });
  expect([timeline.moment.value, timeline.isLive.value]).toEqual([null, false]);
  timeline.receive({ ...STATE, mode: "live" });
  expect(timeline.isLive.value).toBe(true);
});
