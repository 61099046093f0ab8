// Cameras: in the world, as text in the grammar of `camera=` (gateway/scene/draw/cameras.py), and placed to see boxes.

import { Box3, Vector3 } from "three";
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

/** Size of the view as a multiple of that of the framed boxes. */
const MARGIN = 1.12;

export type Direction = "home" | "top" | "bottom" | "front" | "back" | "left" | "side";
/** Directions towards the camera. */
export const DIRECTIONS: Record<Direction, [number, number, number]> = {
  home: [1, -1.2, 0.8],
  top: [0, -1e-4, 1],
  bottom: [0, -1e-4, -1],
  front: [1, 0, 0],
  back: [-1, 0, 0],
  left: [0, 1, 0],
  side: [0, -1, 0],
};

/**
 * Return the nearest camera that has all boxes in view, with equal margins, and half the height of an orthographic view.
 *
 * A point with coordinates a (to the right), b (up) and c (towards the camera) is in view of a camera at (x, y, distance)
 * if |a - x| <= tanX * (distance - c) and |b - y| <= tanY * (distance - c).
 *
 * @param direction unit vector towards the camera
 * @param tanHalfFov tangent of half the vertical field of view
 */
export function frame(boxes: Box3[], direction: Vector3, worldUp: Vector3, tanHalfFov: number, aspect: number) {
  const right = worldUp.clone().cross(direction).normalize();
  const up = direction.clone().cross(right);
  const tanY = tanHalfFov / MARGIN;
  const tanX = tanY * aspect;
  const [range, plus, minus] = [new Box3(), new Box3(), new Box3()];
  const corner = new Vector3();
  for (const { min, max } of boxes)
    for (let k = 0; k < 8; k++) {
      corner.set(k & 1 ? max.x : min.x, k & 2 ? max.y : min.y, k & 4 ? max.z : min.z);
      const [a, b, c] = [corner.dot(right), corner.dot(up), corner.dot(direction)];
      range.expandByPoint(corner.set(a, b, c));
      plus.expandByPoint(corner.set(a + tanX * c, b + tanY * c, 0));
      minus.expandByPoint(corner.set(a - tanX * c, b - tanY * c, 0));
    }
  const distance = Math.max((plus.max.x - minus.min.x) / (2 * tanX), (plus.max.y - minus.min.y) / (2 * tanY));
  const depth = (range.min.z + range.max.z) / 2;
  const target = new Vector3()
    .addScaledVector(right, (plus.max.x + minus.min.x) / 2)
    .addScaledVector(up, (plus.max.y + minus.min.y) / 2)
    .addScaledVector(direction, depth);
  const [x, y] = [target.dot(right), target.dot(up)];
  const halfWidth = Math.max(range.max.x - x, x - range.min.x);
  const halfHeight = Math.max(range.max.y - y, y - range.min.y, halfWidth / aspect);
  const position = target.clone().addScaledVector(direction, Math.max(distance - depth, 1e-3));
  return { position, target, halfHeight: Math.max(1e-3, MARGIN * halfHeight) };
}
