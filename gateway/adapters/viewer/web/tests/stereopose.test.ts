import { afterEach, expect, it, vi } from "vitest";
import { refusal } from "../src/files";
import { placeStereo } from "../src/tools/stereopose";

const view = { eye: [2, -2, 1.5], target: [0, 0, 0.5], up: [0, 0, 1] } as const;
const source = (hasPose: boolean) => ({ stage: { rig: { view, perspective: { fov: 45, aspect: 1.5 } } }, frustum: { hasPose } }) as never;

afterEach(() => vi.unstubAllGlobals());

it("sends where the view is seen from", async () => {
  const fetch = vi.fn(async (..._: [string, RequestInit]) => new Response("{}"));
  vi.stubGlobal("fetch", fetch);
  await placeStereo(source(true));
  const [url, { method }] = fetch.mock.calls[0]!;
  const [path, query] = url.split("?");
  expect([path, method]).toEqual(["cameras/0/pose", "PUT"]);
  expect(new URLSearchParams(query).get("pose")).toMatch(/^eye=2,-2,1.5;target=0,0,0.5;up=0,0,1(;|$)/);
  expect(refusal.value).toBe("");
});

it("says why the camera stays", async () => {
  vi.stubGlobal("fetch", async () => new Response(JSON.stringify({ message: "it follows a node" }), { status: 409 }));
  await placeStereo(source(true));
  expect(refusal.value).toContain("it follows a node");
  await placeStereo(source(false));
  expect(refusal.value).toContain("no stereo camera");
});
