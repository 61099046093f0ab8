import { expect, it } from "vitest";
import type { InterfaceState } from "../src/protocol";
import { lightOf, stateOf, summary } from "../src/tools/interfacelights";

const state = (title: string, more: Partial<InterfaceState> = {}): InterfaceState => ({ title, state: "ready", documentation: "", ...more });
const tree = state("Tree viewer");
const warned = state("Tree viewer", { warnings: ["lengths has a negative number"] });
const failed = state("Stereo camera", { state: "failed", problem: "port 50051 is in use", warnings: ["slow"] });
const starting = state("Kernels", { state: "starting" });

it("says how the connection is before anything else", () => {
  expect(summary("connecting", [failed])).toEqual({ light: "wait", text: "connecting …" });
  expect(summary("closed", [])).toEqual({ light: "bad", text: "reconnecting …" });
  expect(summary("open", [])).toEqual({ light: "good", text: "connected" });
});

it("shows the worst state of all interfaces", () => {
  expect(summary("open", [tree, state("Live scene")])).toEqual({ light: "good", text: "2 interfaces ready" });
  expect(summary("open", [tree])).toEqual({ light: "good", text: "Tree viewer: ready" });
  expect(summary("open", [warned, state("Live scene")])).toEqual({ light: "warn", text: "Tree viewer: 1 warning" });
  expect(summary("open", [warned, state("Live scene", { warnings: ["a", "b"] })])).toEqual({ light: "warn", text: "2 interfaces with warnings" });
  expect(summary("open", [warned, starting])).toEqual({ light: "wait", text: "Kernels: starting" });
  expect(summary("open", [starting, failed, warned])).toEqual({ light: "bad", text: "Stereo camera: failed" });
});

it("has a light for each interface", () => {
  expect([tree, warned, starting, failed].map(lightOf)).toEqual(["good", "warn", "wait", "bad"]);
  expect([tree, warned, starting, failed].map(stateOf)).toEqual(["ready", "1 warning", "starting", "failed"]);
});
