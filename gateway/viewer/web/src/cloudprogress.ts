// Drawing of large point clouds in steps: while something moves, each image has as many chunks as the time allows; at rest,
// the remaining chunks are added to the image frame by frame. Chunks are even samples of their cloud.

import type { Points } from "three";

/** Points in a chunk: one is drawn in milliseconds even without a GPU. */
export const CHUNK_POINTS = 1 << 16;
/** Layer of the chunks that are drawn in this step. */
export const CLOUD_LAYER = 1;
const HIDDEN_LAYER = 2;
/** Milliseconds between two images, above which a step gets fewer chunks, and below which it gets more. */
const SLOW = 60;
const FAST = 30;

export class CloudProgress {
  /** Sorted by their number in their clouds, so that all clouds are refined evenly. */
  private chunks: { object: Points; number: number }[] = [];
  private perStep = 1;
  private next = 0;
  private lastTime = 0;

  add(object: Points, number: number): void {
    object.layers.set(HIDDEN_LAYER);
    this.chunks.push({ object, number });
    this.chunks.sort((a, b) => a.number - b.number);
  }

  remove(objects: ReadonlySet<unknown>): void {
    this.chunks = this.chunks.filter(({ object }) => !objects.has(object));
  }

  /** Choose the chunks of a new image. */
  start(time: number, everything: boolean): void {
    this.adapt(time);
    this.next = 0;
    this.choose(everything ? this.chunks.length : this.perStep);
  }

  /** Choose the chunks to add to the image; return false if it has all of them. */
  refine(time: number): boolean {
    if (this.isComplete) {
      this.lastTime = 0; // the time until the next image is not one of drawing
      return false;
    }
    this.adapt(time);
    this.choose(this.perStep);
    return true;
  }

  /** True if the image has all chunks. */
  get isComplete(): boolean {
    return this.next >= this.chunks.length;
  }

  private choose(count: number): void {
    const end = Math.min(this.next + count, this.chunks.length);
    this.chunks.forEach(({ object }, i) => object.layers.set(i >= this.next && i < end ? CLOUD_LAYER : HIDDEN_LAYER));
    this.next = end;
  }

  private adapt(time: number): void {
    const passed = time - this.lastTime;
    if (this.lastTime && passed > SLOW) this.perStep = Math.max(1, Math.floor(this.perStep / 2));
    else if (this.lastTime && passed < FAST && this.perStep < this.chunks.length) this.perStep = Math.ceil(1.5 * this.perStep);
    this.lastTime = time;
  }
}
