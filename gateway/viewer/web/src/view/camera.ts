// Cameras as text, in the grammar of `camera=` (gateway/scene/cameras.py).

import type { Vector } from "../protocol";

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
