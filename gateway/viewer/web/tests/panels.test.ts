// Panels need `matchMedia` alone of a browser.

import { expect, it, vi } from "vitest";
import { Session } from "../src/session";

vi.stubGlobal("matchMedia", () => ({ matches: false, addEventListener: () => undefined }));
const { Panels } = await import("../src/panels");
const STEREO = { state: "ready", title: "Stereo camera", documentation: "" };

it("has tabs for what is used", () => {
  const session = new Session();
  const panels = new Panels(session);
  expect([panels.tabs.value, panels.shown.value]).toEqual([["Selection"], "Selection"]);
  session.status.value = { kind: "status", interfaces: { stereo: STEREO }, renders: 0 };
  expect([panels.tabs.value, panels.shown.value]).toEqual([["Selection", "Stereo"], "Stereo"]);
  session.status.value = { kind: "status", interfaces: {}, renders: 2 };
  expect([panels.tabs.value, panels.shown.value]).toEqual([["Selection", "Renders"], "Selection"]);
  session.status.value = null;
  expect(panels.tabs.value).toEqual(["Selection", "Renders"]);
});
