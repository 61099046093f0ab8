import { DirectionalLight, LightProbe } from "three";
import { expect, it, vi } from "vitest";
import type { PageLighting } from "../src/protocol";

vi.stubGlobal("matchMedia", () => ({ matches: false }));
const { Lights, NO_CHANGE } = await import("../src/view/lights");
const { ViewLight } = await import("../src/tools/viewlight");

const KEY = { type: "directional", color: [2, 2, 2], position: [0, 0, 0], direction: [0.6, 0, -0.8], range: 0, innerCone: 0, outerCone: 1 };
const LIGHTING = {
  kind: "light",
  lights: [
    { ...KEY, type: "point", castsShadow: false },
    { ...KEY, castsShadow: true },
  ],
  ambient: Array(27).fill(1),
  environment: new Float32Array(6),
  size: [1, 2],
  exposure: 1,
  tone: "none",
} as unknown as PageLighting;

/** Return the direction in which the key light shines. */
function shining(lights: InstanceType<typeof Lights>): number[] {
  const light = lights.object.children.find((each) => each instanceof DirectionalLight)!;
  const [x, y, z] = light.target.position.clone().sub(light.position).normalize().toArray();
  return [x, y, z].map((each) => Math.round(1e6 * each) / 1e6 + 0);
}

it("changes the first directional light and the environment, and changes back", () => {
  const lights = new Lights(null);
  lights.adapt({ azimuth: 90, elevation: 0, strength: 2, ambient: 0.5 }); // before the gateway's light is there
  lights.set(LIGHTING);
  const key = lights.object.children.find((each) => each instanceof DirectionalLight)!;
  const ambient = lights.object.children.find((each) => each instanceof LightProbe)!;
  expect([shining(lights), key.intensity, ambient.intensity]).toEqual([[0, -1, 0], 2, 0.5]);
  lights.adapt({ ...NO_CHANGE, elevation: 90 });
  expect(shining(lights)).toEqual([0, 0, -1]);
  lights.adapt(NO_CHANGE);
  expect([shining(lights), key.intensity, ambient.intensity]).toEqual([[0.6, 0, -0.8], 1, 1]);
});

it("has parameters for the gateway's images only while it is changed", () => {
  const light = new ViewLight(
    () => undefined,
    () => undefined,
  );
  expect(light.query).toEqual({});
  light.change.value = { ...NO_CHANGE, azimuth: -30, ambient: 0 };
  expect(light.query).toEqual({ light_azimuth: "-30", light_ambient: "0" });
});
