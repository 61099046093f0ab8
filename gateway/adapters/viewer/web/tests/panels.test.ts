// Panels need `matchMedia` alone of a browser.

import { signal } from "@preact/signals";
import { expect, it, vi } from "vitest";
import type { ProgramControl } from "../src/programs/programcontrols";
import { Session } from "../src/session";

vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener: () => undefined }));
const { Panels } = await import("../src/panels/panels");
const STEREO = { state: "ready", title: "Stereo camera", documentation: "" };

it("has tabs for what is used", () => {
  const session = new Session();
  const all = signal<ProgramControl[]>([]);
  const panels = new Panels(session, { all });
  expect([panels.tabs.value, panels.shown.value]).toEqual([["Selection"], "Selection"]);
  session.status.value = { kind: "status", interfaces: { stereo: STEREO }, renders: 0 };
  expect([panels.tabs.value, panels.shown.value]).toEqual([["Selection", "Stereo"], "Stereo"]);
  session.status.value = { kind: "status", interfaces: {}, renders: 2 };
  expect([panels.tabs.value, panels.shown.value]).toEqual([["Selection", "Renders"], "Selection"]);
  session.status.value = null;
  expect(panels.tabs.value).toEqual(["Selection", "Renders"]);
  all.value = [{} as ProgramControl];
  expect(panels.tabs.value).toEqual(["Selection", "Controls", "Renders"]);
  all.value = [];
  expect(panels.tabs.value).toEqual(["Selection", "Renders"]);
});
