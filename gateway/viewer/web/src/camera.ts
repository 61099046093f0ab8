// Cameras as text, in the grammar of `camera=` (gateway/scene/cameras.py), and in the page's address.

import type { Followed } from "./follow";
import type { Path } from "./protocol";

type Vector = [number, number, number];

/** A camera in the world, metres. */
export interface CameraView {
  eye: Vector;
  target: Vector;
  up: Vector;
  /** Half the height of the orthographic view, metres. Default: as high as the perspective view at the target. */
  halfHeight?: number;
  orthographic?: boolean;
}

const round = (x: number) => Number(x.toFixed(8));

/** Return the text of a camera whose image has an aspect. */
export function cameraText(view: CameraView, fovy: number, aspect: number): string {
  const { eye, target, up, halfHeight = 1 } = view;
  const size = view.orthographic ? `xmag=${Number((halfHeight * aspect).toPrecision(9))}` : `fovy=${fovy}`;
  return `eye=${eye.map(round)};target=${target.map(round)};up=${up.map(round)};${size}`;
}

/** Parse the text of a free camera whose image has an aspect; return null if it is none. */
export function parseCamera(text: string, aspect: number): CameraView | null {
  const parts = new Map(text.split(";").map((part) => part.split("=", 2) as [string, string]));
  const vector = (name: string, fallback: string) => {
    const numbers = (parts.get(name) ?? fallback).split(",").map(Number);
    return numbers.length === 3 && numbers.every((x) => Number.isFinite(x) && Math.abs(x) <= 1e12) ? (numbers as Vector) : null;
  };
  const [eye, target, up] = [vector("eye", ""), vector("target", ""), vector("up", "0,0,1")];
  if (!eye || !target || !up || String(eye) === String(target) || !up.some(Boolean)) return null;
  const xmag = Number(parts.get("xmag"));
  return xmag > 0 ? { eye, target, up, halfHeight: xmag / aspect, orthographic: true } : { eye, target, up };
}

/** A camera in the page's address. If a node is followed, eye, target and up are relative to it. */
export interface Address {
  camera: CameraView | null;
  followed: Followed | null;
}

/** Return the text of a camera and a followed node for the address, after `#`. */
export function addressText(camera: string, followed: Followed | null): string {
  return followed ? `${camera}&${followed.mode}=${encodeURIComponent(JSON.stringify(followed.path))}` : camera;
}

/** Parse what follows `#` in the address. */
export function parseAddress(text: string, aspect: number): Address {
  const parts = new URLSearchParams(`camera=${text}`); // some programs escape `;`
  const modes = ["follow", "ride"] as const;
  const mode = modes.find((name) => parts.has(name));
  const path = mode && parsePath(parts.get(mode) ?? "");
  return { camera: parseCamera(parts.get("camera") ?? "", aspect), followed: mode && path ? { path, mode } : null };
}

/** Parse a path as JSON; return null if it is none. */
function parsePath(text: string): Path | null {
  try {
    const path = JSON.parse(text) as unknown;
    return Array.isArray(path) && path.every((name) => ["string", "number"].includes(typeof name)) ? path : null;
  } catch {
    return null;
  }
}
