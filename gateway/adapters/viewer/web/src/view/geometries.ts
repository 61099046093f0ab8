// Meshes of the gateway as geometries of three.js, made when they are used.

import { Box3, BufferAttribute, BufferGeometry, Color, Sphere, SRGBColorSpace, Vector3 } from "three";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import type { MeshPayload } from "../protocol";
import { CHUNK_POINTS } from "./cloudprogress";

/** Attributes by their name in a payload: values of a vertex. Colours are bytes. */
const WIDTHS = { position: 3, normal: 3, color: 4, uv: 2, uv1: 2 } as const;

export class Geometries {
  /** Geometries by mesh id and use. */
  private readonly made = new Map<number, Map<string, BufferGeometry[]>>();

  private cached<G extends BufferGeometry>({ id }: MeshPayload, use: string, make: () => G[]): G[] {
    const uses = this.made.get(id) ?? new Map<string, BufferGeometry[]>();
    this.made.set(id, uses);
    const found = uses.get(use) ?? make();
    uses.set(use, found);
    return found as G[];
  }

  dispose(id: number): void {
    for (const geometry of [...(this.made.get(id)?.values() ?? [])].flat()) geometry.dispose();
    this.made.delete(id);
  }

  whole(payload: MeshPayload): BufferGeometry {
    return this.cached(payload, "whole", () => [newGeometry(payload)])[0]!;
  }

  /** Return the geometries of a cloud's chunks; a cloud with an index is one chunk. */
  chunks(payload: MeshPayload): BufferGeometry[] {
    const count = payload.position.length / 3;
    if (payload.index || count <= CHUNK_POINTS) return [this.whole(payload)];
    const { kind, id, box, position, color } = payload;
    const chunk = (_: unknown, number: number) =>
      newGeometry({ kind, id, topology: 1, box, position: chunkOf(position, 3, number), color: color && chunkOf(color, 4, number) });
    return this.cached(payload, "chunks", () => Array.from({ length: Math.ceil(count / CHUNK_POINTS) }, chunk));
  }

  /** Return the geometry of lines of more than one pixel. */
  wideLine(payload: MeshPayload): LineSegmentsGeometry {
    const make = () => {
      const whole = this.whole(payload);
      const { position, color } = (whole.index ? whole.toNonIndexed() : whole).attributes as Record<string, BufferAttribute | undefined>;
      const geometry = new LineSegmentsGeometry().setPositions(position!.array as Float32Array);
      return [color ? geometry.setColors(linearColors(color)) : geometry];
    };
    return this.cached(payload, "wide line", make)[0]!;
  }
}

function newGeometry(payload: MeshPayload): BufferGeometry {
  let geometry = new BufferGeometry();
  for (const [name, width] of Object.entries(WIDTHS)) {
    const values = payload[name as keyof typeof WIDTHS];
    if (values) geometry.setAttribute(name, new BufferAttribute(values, width, name === "color"));
  }
  if (payload.index) geometry.setIndex(new BufferAttribute(payload.index, 1));
  if (payload.topology === 3 && !payload.normal) {
    if (payload.index) geometry = geometry.toNonIndexed(); // flat: triangles share no vertices
    geometry.computeVertexNormals();
  }
  if (payload.box) {
    // Computing the bounds takes a tenth of a second for millions of points.
    const [low, high] = payload.box;
    geometry.boundingBox = new Box3(new Vector3(...low), new Vector3(...high));
    geometry.boundingSphere = geometry.boundingBox.getBoundingSphere(new Sphere());
  }
  return geometry;
}

/** Return a chunk's part of an array with `width` numbers for each point of the cloud. */
export function chunkOf<A extends Float32Array | Uint8Array>(array: A, width: number, number: number): A {
  return array.subarray(width * number * CHUNK_POINTS, width * (number + 1) * CHUNK_POINTS) as A;
}

/** Return the linear colours of a wide line's vertices: the shader of LineMaterial does not convert them from sRGB. */
function linearColors(color: BufferAttribute): Float32Array {
  const linear = new Float32Array(3 * color.count);
  for (let i = 0; i < color.count; i++) new Color().setRGB(color.getX(i), color.getY(i), color.getZ(i), SRGBColorSpace).toArray(linear, 3 * i);
  return linear;
}
