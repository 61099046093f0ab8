// Progressive drawing of large point clouds, in chunks that are even samples of their cloud. While the view changes, each
// image has as many chunks as its time allows. At rest, each frame adds some of the remaining chunks to the image.

import type { Points } from "three";

/** Points in a chunk: drawing one takes milliseconds even without a GPU. */
export const CHUNK_POINTS = 1 << 16;
/** Layer of the chunks that the current frame draws. */
export const CLOUD_LAYER = 1;
const HIDDEN_LAYER = 2;
/** Time between two frames above which the next one draws fewer chunks, milliseconds. */
const SLOW_MS = 60;
/** Time between two frames below which the next one draws more chunks, milliseconds. */
const FAST_MS = 30;

export class CloudProgress {
  /** Chunks of all clouds, sorted by their number in their cloud, so that all clouds are refined evenly. */
  private chunks: { object: Points; number: number }[] = [];
  private chunksPerFrame = 1;
  /** Number of chunks that the image has. */
  private drawnCount = 0;
  /** Time of the last frame; 0 after a pause. */
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
  start(everything: boolean): void {
    this.adaptToTime();
    this.drawnCount = 0;
    this.show(everything ? this.chunks.length : this.chunksPerFrame);
  }

  /** Choose the chunks to add to the image; return false if it has all of them. */
  refine(): boolean {
    if (this.isComplete) {
      this.lastTime = 0; // the pause before the next frame does not count as slow drawing
      return false;
    }
    this.adaptToTime();
    this.show(this.chunksPerFrame);
    return true;
  }

  /** True if the image has all chunks. */
  get isComplete(): boolean {
    return this.drawnCount >= this.chunks.length;
  }

  /** Make the next chunks visible, and no others. */
  private show(count: number): void {
    const end = Math.min(this.drawnCount + count, this.chunks.length);
    for (const [i, { object }] of this.chunks.entries()) object.layers.set(i >= this.drawnCount && i < end ? CLOUD_LAYER : HIDDEN_LAYER);
    this.drawnCount = end;
  }

  private adaptToTime(): void {
    const time = performance.now();
    const passed = time - this.lastTime;
    if (this.lastTime && passed > SLOW_MS) this.chunksPerFrame = Math.max(1, Math.floor(this.chunksPerFrame / 2));
    else if (this.lastTime && passed < FAST_MS && this.chunksPerFrame < this.chunks.length)
      this.chunksPerFrame = Math.ceil(1.5 * this.chunksPerFrame);
    this.lastTime = time;
  }
}
