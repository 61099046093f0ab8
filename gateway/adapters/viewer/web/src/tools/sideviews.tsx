// Beside the view: the scene from above, and the image of a camera.

import { signal } from "@preact/signals";
import { OrthographicCamera, type Scene, Vector2, type Vector3, type WebGLRenderer } from "three";
import { pathText } from "../format";
import { Check, Field } from "../panels/controls";
import type { Path } from "../protocol";
import { isRecorded } from "../recorded/resources";
import { CLOUD_LAYER } from "../view/cloudprogress";
import type { Viewer } from "../view/viewer";

/** Half the height of the view from above, as a multiple of that of the view at its target. */
const ENLARGED = 1.5;

/** The scene from above: drawn by the view's renderer into a corner of its canvas, and copied from there. */
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

  /** Draw the surroundings of a target. The corner of the renderer's canvas is drawn over afterwards. */
  draw(renderer: WebGLRenderer, scene: Scene, target: Vector3, halfHeight: number): void {
    const { canvas, camera } = this;
    if (!this.isShown.peek()) return;
    const view = renderer.getSize(new Vector2());
    const width = Math.min(canvas.clientWidth, view.x);
    const height = Math.min(canvas.clientHeight, view.y);
    if (!width || !height) return;
    const half = ENLARGED * halfHeight;
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

/** Size of a camera's image, pixels. */
const SIZE = "width=480&height=360";

/** Return the name of a camera in the gateway's syntax. */
function cameraName(camera: string): string {
  return camera.startsWith("path:") ? pathText(JSON.parse(camera.slice(5)) as Path) : "Stereo camera";
}

export function SideViews({ viewer: { topView, sideCamera, session, stage, timeline } }: { viewer: Viewer }) {
  const camera = sideCamera.value;
  const { value: moment } = timeline.moment;
  const image = moment === null ? "stream.mjpg?" : `frame.jpg?look=plain&time=${moment}&`;
  if (!topView.isShown.value && !camera) return null;
  const attach = (element: Element | null) => {
    element?.append(topView.canvas);
    stage.redraw();
  };
  return (
    <div class="sideviews" role="group" aria-label="Beside the view">
      {topView.isShown.value && (
        <figure>
          <div ref={attach} />
          <figcaption>From above</figcaption>
        </figure>
      )}
      {camera && (
        <figure key={camera + image + session.connection.value.state}>
          <img src={`view/${image}camera=${encodeURIComponent(camera)}&${SIZE}`} alt={`No image of ${cameraName(camera)} now`} />
          <figcaption>{cameraName(camera)}</figcaption>
        </figure>
      )}
    </div>
  );
}

/** Choices of the display menu: the view from above, and the camera. */
export function SideViewFields({ viewer: { topView, sideCamera, session, stage } }: { viewer: Viewer }) {
  const cameras = new Map([["", "None"]]);
  if (session.status.value?.interfaces?.stereo) cameras.set("stereo", "Stereo camera");
  const { value: selected } = session.selected;
  const ofNode = selected ? `path:${JSON.stringify(selected.path)}` : "";
  for (const camera of [sideCamera.value, ofNode]) if (camera && !cameras.has(camera)) cameras.set(camera, cameraName(camera));
  return (
    <>
      {stage.renderer && (
        <Check
          text="From above"
          title="Around the target of the view"
          checked={topView.isShown.value}
          onChange={(on) => (topView.isShown.value = on)}
        />
      )}
      {!isRecorded() && <Field label="Image of" value={sideCamera.value} choices={[...cameras]} onChange={(camera) => (sideCamera.value = camera)} />}
    </>
  );
}
