// The two cameras of the view, and the controls by which mouse, touch and keyboard move them.

import { Box3, OrthographicCamera, PerspectiveCamera, Raycaster, Vector2, Vector3 } from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import type { Vector } from "../protocol";
import { type CameraView, DIRECTIONS, type Direction, frame } from "./camera";
import { CLOUD_LAYER } from "./cloudprogress";

/** Vertical field of view, degrees. */
const FOV = 45;
const TAN_HALF_FOV = Math.tan((FOV * Math.PI) / 360);
/** Distance between the origin of the page's scene and the view's target above which the origin moves, metres: in single
 * precision, coordinates are 0.06 mm apart there. */
const MAX_TARGET_DISTANCE = 1000;
const Z_UP = new Vector3(0, 0, 1);
/** Box that is framed while the scene is empty. */
const DEFAULT_BOX = new Box3(new Vector3(-1, -1, 0), new Vector3(1, 1, 1));

export class CameraRig {
  readonly perspective = new PerspectiveCamera(FOV, 1, 0.01, 1000);
  readonly orthographic = new OrthographicCamera(-1, 1, 1, -1, -1000, 1000);
  camera: PerspectiveCamera | OrthographicCamera = this.perspective;
  /** Direction about which the controls turn the camera. */
  private readonly controlsUp = new Vector3();
  controls: OrbitControls;
  /** Point of the world at which the page's scene has its origin. It is near the target, where coordinates have to be precise. */
  readonly origin = new Vector3();
  /** Number of times that the camera was placed, or taken by the visitor. */
  placements = 0;
  /** Half the height of the orthographic view, metres. */
  private halfHeight = 1;
  /** Distance of the target when the camera was last placed, metres. */
  private framedDistance = 1;

  /** @param placed called with half the height of the view at its target, metres, after the camera was placed */
  constructor(
    holder: HTMLElement,
    private readonly canvas: HTMLElement,
    private readonly moved: () => void,
    private readonly placed: (halfHeight: number) => void,
  ) {
    for (const camera of [this.perspective, this.orthographic]) camera.layers.enable(CLOUD_LAYER);
    this.setUp(Z_UP);
    this.controls = this.newControls();
    for (const type of ["pointerdown", "wheel", "keydown"])
      holder.addEventListener(type, () => this.renewControls(), { capture: true, passive: true });
  }

  private newControls(): OrbitControls {
    const controls = new OrbitControls(this.camera, this.canvas);
    this.controlsUp.copy(this.camera.up);
    controls.zoomToCursor = true;
    controls.listenToKeyEvents(this.canvas);
    controls.addEventListener("change", this.moved);
    controls.addEventListener("start", () => (this.placements += 1));
    return controls;
  }

  /** Turn about the direction that is up, from the next drag on. OrbitControls reads it only in its constructor. */
  private renewControls(): void {
    if (this.controlsUp.equals(this.camera.up)) return;
    const { target } = this.controls;
    this.controls.dispose();
    this.controls = this.newControls();
    this.controls.target.copy(target);
  }

  private setUp(up: Vector3): void {
    for (const camera of [this.perspective, this.orthographic]) camera.up.copy(up);
  }

  /** Half the height of the perspective view at the target, metres. */
  get halfHeightAtTarget(): number {
    return this.controls.getDistance() * TAN_HALF_FOV;
  }

  /** The camera in the world. */
  get view(): CameraView {
    const [eye, target] = [this.camera.position, this.controls.target].map((at) => at.clone().add(this.origin).toArray()) as [Vector, Vector];
    const halfHeight = this.halfHeight / this.orthographic.zoom;
    return { eye, target, up: this.camera.up.toArray(), halfHeight, orthographic: this.camera === this.orthographic };
  }

  /** Place the camera in the world. */
  place(view: CameraView): void {
    this.move(view);
    this.finishPlacing(view.halfHeight ?? this.halfHeightAtTarget);
  }

  /** Move the camera in the world, as it is moved along with a node. */
  move({ eye, target, up }: CameraView): void {
    this.setUp(new Vector3(...up));
    this.set(new Vector3(...eye).sub(this.origin), new Vector3(...target).sub(this.origin));
  }

  /** Frame boxes from the current direction. */
  fit(boxes: Box3[]): void {
    if (boxes.length) this.frame(boxes, this.camera.position.clone().sub(this.controls.target).normalize());
  }

  /** Frame boxes from a named direction. */
  look(direction: Direction, boxes: Box3[]): void {
    this.setUp(Z_UP);
    const shown = boxes.length ? boxes : [DEFAULT_BOX.clone().translate(this.origin.clone().negate())];
    this.frame(shown, new Vector3(...DIRECTIONS[direction]).normalize());
  }

  /** Move the camera to the nearest place from which all boxes are in view, with equal margins. */
  private frame(boxes: Box3[], direction: Vector3): void {
    const { position, target, halfHeight } = frame(boxes, direction, this.camera.up, TAN_HALF_FOV, this.perspective.aspect);
    this.set(position, target);
    this.finishPlacing(halfHeight);
  }

  private set(position: Vector3, target: Vector3): void {
    for (const camera of [this.perspective, this.orthographic]) camera.position.copy(position);
    this.controls.target.copy(target);
    this.moved();
  }

  private finishPlacing(halfHeight: number): void {
    this.placements += 1;
    this.orthographic.zoom = 1;
    this.halfHeight = halfHeight;
    this.controls.update();
    this.framedDistance = this.controls.getDistance();
    this.placed(halfHeight);
  }

  /**
   * Move the target along the view to the depth of a point of the geometry, since the wheel moves the camera by a fraction of
   * the target's distance. Over nothing, the camera is not stuck at the target: the distance has a minimum.
   */
  aim(point: Vector3 | undefined): void {
    if (this.camera !== this.perspective) return;
    const { position } = this.camera;
    const forward = this.camera.getWorldDirection(new Vector3());
    const depth = point ? point.clone().sub(position).dot(forward) : Math.max(this.controls.getDistance(), this.framedDistance / 20);
    this.controls.target.copy(position).addScaledVector(forward, depth);
  }

  setOrthographic(on: boolean): void {
    const next = on ? this.orthographic : this.perspective;
    if (next === this.camera) return;
    if (on) this.halfHeight = this.halfHeightAtTarget;
    next.position.copy(this.camera.position);
    this.camera = this.controls.object = next;
    this.controls.update();
  }

  /** Return what finds hits of geometry at a point of the page, pixels. */
  rayAt(x: number, y: number): Raycaster {
    const rect = this.canvas.getBoundingClientRect();
    const caster = new Raycaster();
    caster.setFromCamera(new Vector2(((x - rect.left) / rect.width) * 2 - 1, 1 - ((y - rect.top) / rect.height) * 2), this.camera);
    caster.layers.enableAll();
    caster.params.Points.threshold = caster.params.Line.threshold = 0.01 * this.controls.getDistance();
    return caster;
  }

  /** Adopt the size of the view on the page, pixels. */
  resize(width: number, height: number): void {
    const { perspective, orthographic, halfHeight: half } = this;
    perspective.aspect = width / height;
    const [right, top] = [(half * width) / height, half];
    Object.assign(orthographic, { left: -right, right, top, bottom: -top });
    for (const camera of [perspective, orthographic]) camera.updateProjectionMatrix();
  }

  /** Scale the clipping planes with the camera's distance, for close-ups and wide views. */
  updateClippingPlanes(): void {
    const distance = Math.max(this.controls.getDistance(), 1e-4);
    Object.assign(this.perspective, { near: distance / 500, far: distance * 2000 });
    Object.assign(this.orthographic, { near: -1000 * distance, far: 1000 * distance });
    this.camera.updateProjectionMatrix();
  }

  /** Move the origin to round coordinates near the target, if it is far from them; return true if it moved. */
  moveOrigin(): boolean {
    const { target } = this.controls;
    if (target.length() <= MAX_TARGET_DISTANCE) return false;
    const shift = target.clone().divideScalar(MAX_TARGET_DISTANCE).round().multiplyScalar(MAX_TARGET_DISTANCE);
    this.origin.add(shift);
    this.set(this.camera.position.clone().sub(shift), target.clone().sub(shift));
    this.controls.update();
    return true;
  }
}
