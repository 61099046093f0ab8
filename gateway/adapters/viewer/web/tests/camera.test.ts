import { expect, it } from "vitest";
import { addressText, parseAddress, parseCamera } from "../src/tools/address";
import { cameraText } from "../src/view/camera";
import { NO_CHANGE } from "../src/view/lights";

const VIEW = { eye: [500000.125, 0, -2.5], target: [0, 1, 0], up: [0, 0, 1] } as const;

it("writes and reads a perspective camera", () => {
  const text = cameraText({ ...VIEW, eye: [...VIEW.eye], target: [...VIEW.target], up: [...VIEW.up] }, 45, 1.5);
  expect(text).toBe("eye=500000.125,0,-2.5;target=0,1,0;up=0,0,1;fovy=45");
  expect(parseCamera(text, 1.5)).toEqual({ eye: [500000.125, 0, -2.5], target: [0, 1, 0], up: [0, 0, 1] });
});

it("writes and reads an orthographic camera", () => {
  const view = { eye: [0, -9, 0], target: [0, 0, 0], up: [0, 0, 1], halfHeight: 2, orthographic: true } as const;
  const text = cameraText({ ...view, eye: [...view.eye], target: [...view.target], up: [...view.up] }, 45, 1.5);
  expect(text).toBe("eye=0,-9,0;target=0,0,0;up=0,0,1;xmag=3");
  expect(parseCamera(text, 0.5)).toMatchObject({ halfHeight: 6, orthographic: true });
});

it.each(["", "fit", "eye=1,2;target=0,0,0", "eye=1,2,x;target=0,0,0", "eye=1,2,3;target=1,2,3", "eye=1e99,2,3;target=0,0,0"])("refuses %s", (text) =>
  expect(parseCamera(text, 1)).toBeNull(),
);

it("has an up direction of its own", () => {
  expect(parseCamera("eye=1,2,3;target=0,0,0", 1)?.up).toEqual([0, 0, 1]);
  expect(parseCamera("eye=1,2,3;target=0,0,0;up=0,0,0", 1)).toBeNull();
});

it("writes and reads an address with the node that the camera follows", () => {
  const camera = "eye=1,2,3;target=0,0,0;up=0,0,1;fovy=45";
  const followed = { path: ["a&b", 3, "#"], mode: "ride" } as const;
  const text = addressText(camera, { ...followed, path: [...followed.path] });
  expect(parseAddress(text, 1)).toEqual({ camera: parseCamera(camera, 1), followed, time: null, light: NO_CHANGE });
  expect(addressText(camera, null)).toBe(camera);
  expect(parseAddress(camera.replaceAll(";", "%3B"), 1)).toEqual({ camera: parseCamera(camera, 1), followed: null, time: null, light: NO_CHANGE });
});

it.each(["follow=", "follow=robot", 'follow={"a":1}', "follow=[null]", "ride=[["])("follows nothing with %s", (text) =>
  expect(parseAddress(`eye=1,2,3;target=0,0,0&${text}`, 1).followed).toBeNull(),
);

it("reads the light of an address, as far as the gateway takes it", () => {
  const light = (text: string) => parseAddress(text, 1).light;
  expect(light("eye=1,2,3;target=0,0,0&light_azimuth=-30&light_ambient=0")).toEqual({ ...NO_CHANGE, azimuth: -30, ambient: 0 });
  expect(light("&light_strength=2.5")).toEqual({ ...NO_CHANGE, strength: 2.5 });
  expect(light("&light_elevation=91&light_strength=-1&light_ambient=x")).toBe(NO_CHANGE);
});
