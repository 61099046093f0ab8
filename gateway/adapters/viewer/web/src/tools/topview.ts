// The scene from above, in a small view of its own.

import { signal } from "@preact/signals";
import { OrthographicCamera, Vector2 } from "three";
import { CLOUD_LAYER } from "../view/cloudprogress";
import type { Stage } from "../view/stage";

/** Half the height of the view from above, as a multiple of that of the view at its target. */
const ENLARGED = 1.5;

/** Drawn by the view's renderer into a corner of its canvas, and copied from there. */
export class TopView {
  /** True: it is beside the view. */
  readonly isShown = signal(false);
  readonly canvas = document.createElement("canvas");
  private readonly camera = new OrthographicCamera();

  constructor() {
    this.canvas.setAttribute("aria-label", "The scene from above");
    this.canvas.setAttribute("role", "img");
    this.camera.layers.enable(CLOUD_LAYER);
  }

  /** Draw the surroundings of the view's target. The corner of the renderer's canvas is drawn over afterwards. */
  draw({ renderer, scene, rig }: Stage): void {
    const { canvas, camera } = this;
    if (!renderer || !this.isShown.peek()) return;
    const { target } = rig.controls;
    const view = renderer.getSize(new Vector2());
    const width = Math.min(canvas.clientWidth, view.x);
    const height = Math.min(canvas.clientHeight, view.y);
    if (!width || !height) return;
    const half = ENLARGED * rig.halfHeightAtTarget;
    Object.assign(camera, { left: (-half * width) / height, right: (half * width) / height, top: half, bottom: -half });
    Object.assign(camera, { near: 0, far: 2000 * half });
    camera.updateProjectionMatrix();
    camera.position.copy(target).setZ(target.z + 1000 * half);
    camera.lookAt(target);
    renderer.setViewport(0, 0, width, height);
    renderer.setScissor(0, 0, width, height);
    renderer.setScissorTest(true);
    renderer.render(scene, camera);
    renderer.setScissorTest(false);
    renderer.setViewport(0, 0, view.x, view.y);
    const ratio = renderer.getPixelRatio();
    const [w, h] = [Math.floor(width * ratio), Math.floor(height * ratio)];
    if (canvas.width !== w || canvas.height !== h) Object.assign(canvas, { width: w, height: h });
    canvas.getContext("2d")?.drawImage(renderer.domElement, 0, renderer.domElement.height - h, w, h, 0, 0, w, h);
  }
}
