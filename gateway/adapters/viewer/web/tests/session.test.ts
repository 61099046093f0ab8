import { describe, expect, it } from "vitest";
import type { NodeUpdate } from "../src/protocol";
import { Session } from "../src/session";
import { update } from "./scene";

const ROBOT: NodeUpdate = { id: 1, parent: 0, name: "robot", parts: [] };

describe("Session", () => {
  it("selects a node again after it was removed and published", () => {
    const session = new Session();
    session.apply(update(1, [ROBOT]));
    session.select(session.model.find(["robot"]));
    session.apply(update(2, [], {}, [1]));
    expect(session.selected.value).toBeNull();
    expect(session.awaited.value).toEqual(["robot"]);
    session.apply(update(3, [{ ...ROBOT, id: 2 }]));
    expect(session.selected.value?.id).toBe(2);
    expect(session.awaited.value).toBeNull();
  });

  it("forgets a removed node when something else is selected", () => {
    const session = new Session();
    session.apply(update(1, [ROBOT]));
    session.select(session.model.find(["robot"]));
    session.apply(update(2, [], {}, [1]));
    session.select(null);
    session.apply(update(3, [ROBOT]));
    expect(session.selected.value).toBeNull();
  });

  it("says whether the scene is empty, and counts changes of nodes but not of poses", () => {
    const session = new Session();
    session.apply(update(1, []));
    expect(session.isEmpty.value).toBe(true);
    const before = session.changes.value;
    session.apply(update(2, [ROBOT]));
    expect([session.isEmpty.value, session.changes.value]).toEqual([false, before + 1]);
    session.apply(update(3, [], { 1: [1, 2, 3, 1, 0, 0, 0] }));
    expect(session.changes.value).toBe(before + 1);
    expect(session.model.find(["robot"])?.world.elements.slice(12, 15)).toEqual([1, 2, 3]);
    expect(session.tick(7)).toBe(true);
    expect(session.rates.value).toEqual({ nodes: 1, revision: 3, updates: 3, frames: 7 });
    expect(session.tick(9)).toBe(false);
    expect(session.rates.value.frames).toBe(2);
  });

  it("keeps what the page has set for a node that is published again", () => {
    const session = new Session();
    session.apply(update(1, [ROBOT]));
    Object.assign(session.model.find(["robot"]) as object, { shown: false, ownOpacity: 0.5 });
    session.apply(update(2, [], {}, [1]));
    session.apply(update(3, [{ ...ROBOT, id: 5 }]));
    expect(session.model.find(["robot"])).toMatchObject({ id: 5, isShown: false, shownOpacity: 0.5 });
  });

  it("says what a lost connection leaves", () => {
    const session = new Session();
    session.setConnection("closed", "");
    expect(session.notice.value).toEqual({ text: "The gateway does not respond; this page keeps trying.", centre: true });
    session.setConnection("open", "");
    session.apply(update(1, [ROBOT]));
    expect(session.notice.value.text).toBe("");
    session.setConnection("closed", "");
    expect(session.notice.value).toEqual({ text: "The gateway does not respond; this is the scene as it was.", centre: false });
    session.setConnection("closed", "too many pages");
    expect(session.notice.value.text).toBe("too many pages");
  });

  it("streams while a client has a stream", () => {
    const session = new Session();
    session.status.value = { kind: "status", facts: [{ name: "streams", value: 0 }] };
    expect(session.streaming.value).toBe(false);
    session.status.value = { kind: "status", facts: [{ name: "streams", value: 2 }] };
    expect(session.streaming.value).toBe(true);
  });
});
