// The stereo camera in the scene: the frusta of its left and right camera as lines.

import { BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments, Matrix4, Object3D } from "three";
import type { PlacedRig, Rig } from "./protocol";

/** Distance of the drawn image plane from the camera, metres. */
const IMAGE_PLANE_DISTANCE = 0.25;

export class Frustum {
  readonly object = new Object3D();
  readonly material = new LineBasicMaterial();
  private readonly lines = new LineSegments(new BufferGeometry(), this.material);
  private shape = "";
  private hasPose = false;
  private isShown = false;

  constructor(private readonly redraw: () => void) {
    this.object.matrixAutoUpdate = false;
    this.object.visible = false;
    this.object.add(this.lines);
  }

  /** Show or hide the camera. Without a pose it stays hidden. */
  setShown(on: boolean): void {
    this.isShown = on;
    this.object.visible = this.hasPose && on;
    this.redraw();
  }

  show(rig: Rig): void {
    this.hasPose = rig.pose !== null;
    this.object.visible = this.hasPose && this.isShown;
    if (rig.pose) {
      this.object.matrix.copy(new Matrix4().fromArray(rig.pose));
      this.object.matrixWorldNeedsUpdate = true;
      const shape = JSON.stringify([rig.width, rig.height, rig.fx, rig.fy, rig.cx, rig.cy, rig.baseline]);
      if (shape !== this.shape) this.build(rig);
      this.shape = shape;
    }
    this.redraw();
  }

  private build(rig: PlacedRig): void {
    const points: number[] = [];
    for (const offset of [0, rig.baseline]) {
      const corner = (x: number, y: number): [number, number, number] => [
        offset + ((x - rig.cx) / rig.fx) * IMAGE_PLANE_DISTANCE,
        ((y - rig.cy) / rig.fy) * IMAGE_PLANE_DISTANCE,
        IMAGE_PLANE_DISTANCE,
      ];
      const corners = [corner(0, 0), corner(rig.width, 0), corner(rig.width, rig.height), corner(0, rig.height)];
      for (const [i, at] of corners.entries()) points.push(offset, 0, 0, ...at, ...at, ...(corners[(i + 1) % 4] ?? at));
      // A tick above the image plane marks the up direction.
      points.push(...corner(rig.width * 0.44, 0), ...corner(rig.width * 0.5, -rig.height * 0.09));
      points.push(...corner(rig.width * 0.5, -rig.height * 0.09), ...corner(rig.width * 0.56, 0));
    }
    points.push(0, 0, 0, rig.baseline, 0, 0);
    this.lines.geometry.dispose();
    this.lines.geometry = new BufferGeometry();
    this.lines.geometry.setAttribute("position", new BufferAttribute(new Float32Array(points), 3));
  }
}
