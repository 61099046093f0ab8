// Measurement between two points of the world: the points, a line between them in the scene, and a bar over the view.

import { effect, signal } from "@preact/signals";
import { BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments, Object3D, Points, PointsMaterial, Vector3 } from "three";
import { shortRow } from "../format";
import type { Vector } from "../protocol";
import { Button, Pill } from "../widgets/controls";

/** Return what a measurement says: the first point, then the distance, its parts along the axes, and the two points. */
export function measured(points: readonly Vector[]): { distance: string; details: string; ends?: string } {
  const [first, second] = points.map((point) => new Vector3(...point));
  if (!first) return { distance: "", details: "Click a point in the scene." };
  const from = `${shortRow(first.toArray(), 1000)} m`;
  if (!second) return { distance: "", details: `${from}. Click a second point.` };
  const difference = second.clone().sub(first);
  const metres = difference.length();
  const ends = `, from ${from}, to ${shortRow(second.toArray(), 1000)} m`;
  return { distance: `${Number(metres.toPrecision(4))} m`, details: `Δ ${shortRow(difference.toArray(), metres)} m`, ends };
}

export class Measurement {
  /** Up to two points in the world, metres. Null: clicks do not measure. */
  readonly points = signal<Vector[] | null>(null);
  /** Line and ends; its origin is the first point, since the GPU gets coordinates in single precision. */
  readonly object = new Object3D();
  readonly materials = [
    new LineBasicMaterial({ depthTest: false, transparent: true }),
    new PointsMaterial({ size: 8, sizeAttenuation: false, depthTest: false, transparent: true }),
  ] as const;

  constructor(redraw: () => void) {
    const geometry = new BufferGeometry();
    const objects = [new LineSegments(geometry, this.materials[0]), new Points(geometry, this.materials[1])];
    for (const object of objects) Object.assign(object, { renderOrder: 1, frustumCulled: false }); // over everything
    this.object.add(...objects);
    effect(() => {
      const [first, ...others] = this.points.value ?? [];
      this.object.visible = first !== undefined;
      if (first) {
        this.object.position.set(...first);
        const offsets = others.flatMap((point) => point.map((x, i) => x - first[i]!));
        geometry.setAttribute("position", new BufferAttribute(new Float32Array([0, 0, 0, ...offsets]), 3));
      }
      redraw();
    });
  }

  toggle = (): void => {
    this.points.value = this.points.peek() ? null : [];
  };

  /** Stop measuring; return true if clicks measured. */
  stop(): boolean {
    const wasOn = this.points.peek() !== null;
    this.points.value = null;
    return wasOn;
  }

  /** Take a point; a third one starts again. */
  add(point: Vector): void {
    const points = this.points.peek() ?? [];
    this.points.value = [...(points.length < 2 ? points : []), point];
  }
}

export function MeasureBar({ measurement }: { measurement: Measurement }) {
  const points = measurement.points.value;
  if (!points) return null;
  const { distance, details, ends } = measured(points);
  return (
    <Pill label="Measurement" icon="measure">
      <span role="status">
        <strong>{distance}</strong> {details}
        <span class="ends">{ends}</span>
      </span>
      <Button icon="close" title="Stop measuring (M)" onClick={measurement.toggle} />
    </Pill>
  );
}
