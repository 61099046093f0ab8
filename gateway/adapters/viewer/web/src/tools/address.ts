// What follows `#` in the page's address: the camera, the moment and the light that are shown. A link to it, and a page that is loaded again, show
// the same view.

import type { Path, Vector } from "../protocol";
import { type CameraView, cameraText } from "../view/camera";
import type { CameraRig } from "../view/camerarig";
import { type LightChange, NO_CHANGE } from "../view/lights";
import type { Follow, Followed } from "./follow";
import type { Timeline } from "./timeline";
import type { ViewLight } from "./viewlight";

/** Shortest time between two changes of the address, ms: browsers limit them. */
const PERIOD_MS = 500;

export class CameraAddress {
  private timer = 0;
  /** The hash that was last read or written: another one is a link whose event is still to come. */
  private known = location.hash;

  /** @param isHome returns true in the home view, which the address does not name */
  constructor(
    private readonly rig: CameraRig,
    private readonly follow: Follow,
    private readonly timeline: Timeline,
    private readonly viewLight: ViewLight,
    private readonly isHome: () => boolean,
  ) {}

  private text(): string {
    const followed = this.follow.followed.peek();
    const moment = this.timeline.moment.peek();
    const time = moment === null ? [] : [["time", moment.toFixed(6)]];
    const rest = [...time, ...Object.entries(this.viewLight.query)].map(([name, value]) => `&${name}=${value}`).join("");
    if (this.isHome() && !followed) return rest && `#${rest}`;
    const { view, perspective } = this.rig;
    return `#${addressText(cameraText(this.follow.relative(view), perspective.fov, perspective.aspect), followed)}${rest}`;
  }

  /** Write the view into the address soon. */
  write(): void {
    this.timer ||= setTimeout(() => {
      this.timer = 0;
      const hash = this.text();
      if (hash === location.hash || this.known !== location.hash) return;
      try {
        history.replaceState(null, "", location.pathname + location.search + hash);
        this.known = location.hash;
      } catch {
        // Inside another page, as in a notebook, a file has no address.
      }
    }, PERIOD_MS);
  }

  /** Call back with the view of the address, now and when a link is followed. */
  read(place: (address: Address) => void): void {
    const read = () => {
      this.known = location.hash;
      place(parseAddress(this.known.slice(1), this.rig.perspective.aspect));
    };
    addEventListener("hashchange", read);
    read();
  }
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

/** A view in the page's address. If a node is followed, eye, target and up are relative to it. */
export interface Address {
  camera: CameraView | null;
  followed: Followed | null;
  /** Seconds since the epoch; null: now. */
  time: number | null;
  light: LightChange;
}

/** Smallest and largest value of each change of the light, as the gateway takes them. */
const LIGHT_LIMITS: Record<keyof LightChange, [number, number]> = {
  azimuth: [-360, 360],
  elevation: [-90, 90],
  strength: [0, 100],
  ambient: [0, 100],
};

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
  const time = Number(parts.get("time"));
  return {
    camera: parseCamera(parts.get("camera") ?? "", aspect),
    followed: mode && path ? { path, mode } : null,
    time: time > 0 ? time : null,
    light: parseLight(parts),
  };
}

/** Return the light of the address. What it does not name, or names with an invalid value, is the gateway's. */
function parseLight(parts: URLSearchParams): LightChange {
  const named = Object.entries(LIGHT_LIMITS).flatMap(([name, [least, most]]) => {
    const value = Number.parseFloat(parts.get(`light_${name}`) ?? "");
    return value >= least && value <= most ? [[name, value]] : [];
  });
  return named.length ? { ...NO_CHANGE, ...Object.fromEntries(named) } : NO_CHANGE;
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
