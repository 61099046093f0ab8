// The stereo camera in the scene: the frusta of its left and right camera as lines.

import { BufferGeometry, Float32BufferAttribute, LineBasicMaterial, LineSegments, type Vector3 } from "three";
import type { NoRig, PlacedRig, Vector } from "../protocol";

/** Distance of the drawn image plane from the camera, metres. */
const IMAGE_PLANE_DISTANCE = 0.25;
/** Distance from the view's camera below which the lines are not drawn, metres: their ends would lie anywhere on the screen. */
const MIN_DISTANCE = 0.01;

export class Frustum {
  readonly object = new LineSegments(new BufferGeometry(), new LineBasicMaterial());
  /** Width and height of the camera's images, pixels. */
  imageSize: [number, number] | null = null;
  /** True if the camera is in this scene. */
  hasPose = false;
  private isShown = false;

  constructor(private readonly redraw: () => void) {
    this.object.matrixAutoUpdate = false;
    this.setShown();
  }

  /** Adapt to the place of the view's camera in the world. */
  seenFrom(eye: Vector3): void {
    const [x, y, z] = this.object.matrix.elements.slice(12, 15) as Vector;
    this.object.visible = this.hasPose && this.isShown && Math.hypot(eye.x - x, eye.y - y, eye.z - z) > MIN_DISTANCE;
  }

  /** Show or hide the camera. Without a pose it stays hidden. */
  setShown(on = this.isShown): void {
    this.isShown = on;
    this.object.visible = this.hasPose && on;
    this.redraw();
  }

  show(rig: PlacedRig | NoRig): void {
    this.hasPose = rig.pose !== null;
    if (rig.pose) {
      this.imageSize = [rig.width, rig.height];
      this.object.matrix.fromArray(rig.pose);
      this.object.matrixWorldNeedsUpdate = true;
      this.object.geometry.dispose();
      this.object.geometry = new BufferGeometry().setAttribute("position", new Float32BufferAttribute(linesOf(rig), 3));
    }
    this.setShown();
  }
}

/** Return the ends of the lines, x, y, z of each, in the left camera's optical frame. */
function linesOf(rig: PlacedRig): number[] {
  const points = [0, 0, 0, rig.baseline, 0, 0];
  for (const offset of [0, rig.baseline]) {
    const corner = (x: number, y: number): Vector => [
      offset + ((x - rig.cx) / rig.fx) * IMAGE_PLANE_DISTANCE,
      ((y - rig.cy) / rig.fy) * IMAGE_PLANE_DISTANCE,
      IMAGE_PLANE_DISTANCE,
    ];
    const corners = [corner(0, 0), corner(rig.width, 0), corner(rig.width, rig.height), corner(0, rig.height)];
    for (const [i, at] of corners.entries()) points.push(offset, 0, 0, ...at, ...at, ...(corners[(i + 1) % 4] ?? at));
    // A tick above the image plane marks the up direction.
    const tip = corner(rig.width * 0.5, -rig.height * 0.09);
    points.push(...corner(rig.width * 0.44, 0), ...tip, ...tip, ...corner(rig.width * 0.56, 0));
  }
  return points;
}
