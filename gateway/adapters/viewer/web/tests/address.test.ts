import { afterEach, beforeEach, expect, it, vi } from "vitest";
import type { Follow } from "../src/tools/follow";
import type { Timeline } from "../src/tools/timeline";
import type { ViewLight } from "../src/tools/viewlight";
import type { CameraRig } from "../src/view/camerarig";

const location = { pathname: "/view/", search: "", hash: "" };
const light = { query: {} as Record<string, number> };
let followLink: () => void;

beforeEach(() => {
  vi.useFakeTimers();
  location.hash = "";
  vi.stubGlobal("location", location);
  vi.stubGlobal("history", { replaceState: (_: null, __: string, url: string) => (location.hash = url.replace("/view/", "")) });
  vi.stubGlobal("addEventListener", (_: string, listener: () => void) => (followLink = listener));
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
});

it("does not write over a link that is being followed", async () => {
  const { CameraAddress } = await import("../src/tools/address");
  const follow = { followed: { peek: () => null } } as unknown as Follow;
  const timeline = { moment: { peek: () => null } } as unknown as Timeline;
  const rig = { perspective: { aspect: 1 } } as unknown as CameraRig;
  const address = new CameraAddress(rig, follow, timeline, light as unknown as ViewLight, () => true);
  const read = vi.fn();
  address.read(read);

  light.query = { light_strength: 0.25 };
  address.write();
  vi.runAllTimers();
  expect(location.hash).toBe("#&light_strength=0.25");

  address.write();
  location.hash = "#&light_strength=0.5"; // browsers tell it later
  vi.runAllTimers();
  followLink();
  expect(read.mock.lastCall?.[0].light.strength).toBe(0.5);
});
