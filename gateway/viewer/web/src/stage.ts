// The 3D view: camera, controls, lights, grid and axes. It draws only after a change.

import {
  AxesHelper,
  Box3,
  Box3Helper,
  Color,
  GridHelper,
  type Intersection,
  type Matrix4,
  Object3D,
  OrthographicCamera,
  PerspectiveCamera,
  Raycaster,
  Scene,
  Vector2,
  Vector3,
  type WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { LinearImage } from "./blending";
import type { CameraView } from "./camera";
import { CLOUD_LAYER, CloudProgress } from "./cloudprogress";
import { moved } from "./follow";
import { DIRECTIONS, type Direction, frame } from "./framing";
import { Lights } from "./lights";
import { AmbientOcclusion } from "./occlusion";
import { newRenderer } from "./renderer";
import { BEFORE_SURFACE, BEHIND_SURFACE, patch } from "./shaders";

/** Vertical field of view, degrees. */
const FOV = 45;
const TAN_HALF_FOV = Math.tan((FOV * Math.PI) / 360);
/** Distance between the origin of the page's scene and the view's target above which the origin moves, metres: in single
 * precision, coordinates are 0.06 mm apart there. */
const MAX_TARGET_DISTANCE = 1000;
const Z_UP = new Vector3(0, 0, 1);
/** Box that is framed while the scene is empty. */
const DEFAULT_BOX = new Box3(new Vector3(-1, -1, 0), new Vector3(1, 1, 1));
type Vector = [number, number, number];

export interface StageCallbacks {
  /** Returns the URL of the gateway's image of this view, which is shown without WebGL. */
  imageUrl(): string;
  /** Returns true if the scene has translucent surfaces. */
  isTranslucent(): boolean;
  /** Called before an image is drawn. `halfHeight` is half the view's height at the target, metres. */
  drawing(renderer: WebGLRenderer, halfHeight: number): void;
  /** Called after an image was drawn. */
  drawn(): void;
  /** Called when the camera moved. */
  moved(): void;
  /** Called after `origin` has changed. */
  originMoved(): void;
}

export class Stage {
  readonly scene = new Scene();
  /** Null without WebGL: `canvas` is an image of the gateway then. */
  readonly renderer = newRenderer();
  readonly canvas: HTMLElement;
  readonly grid = new GridHelper(20, 20, 0xffffff, 0xffffff);
  readonly axes = new AxesHelper(0.5);
  readonly perspective = new PerspectiveCamera(FOV, 1, 0.01, 1000);
  readonly orthographic = new OrthographicCamera(-1, 1, 1, -1, -1000, 1000);
  camera: PerspectiveCamera | OrthographicCamera = this.perspective;
  controls: OrbitControls;
  /** Direction about which the controls turn the camera. */
  private readonly controlsUp = new Vector3();
  /** Point clouds of several chunks. */
  readonly clouds = new CloudProgress();
  readonly lights: Lights;
  private readonly linearImage: LinearImage | null;
  /** Null: off. */
  private occlusion: AmbientOcclusion | null = null;
  private readonly highlight = new Box3Helper(new Box3(), new Color(0xff9500));
  private dirty = true;
  /** Half the height of the orthographic view, metres. */
  private halfHeight = 1;
  /** Distance of the target when the camera was last placed, metres. */
  private framedDistance = 1;
  /** Number of frames drawn. */
  frames = 0;
  /** Number of times that the camera was placed, or taken by the visitor. */
  placements = 0;

  /** Objects of the scene, which `pick` searches. */
  readonly content = new Object3D();
  /** Objects that are placed in the world: axes, the stereo camera. */
  readonly world = new Object3D();
  /** Point of the world at which `scene` has its origin. It is near the view's target, where coordinates have to be precise. */
  readonly origin = new Vector3();

  constructor(
    private readonly holder: HTMLElement,
    private readonly callbacks: StageCallbacks,
  ) {
    this.canvas = this.renderer?.domElement ?? Object.assign(new Image(), { alt: "", draggable: false });
    this.linearImage = this.renderer && new LinearImage(this.renderer);
    this.lights = new Lights(this.renderer);
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("aria-label", "3D view of the scene");
    holder.append(this.canvas);
    for (const camera of [this.perspective, this.orthographic]) {
      camera.up.copy(Z_UP);
      camera.layers.enable(CLOUD_LAYER);
    }
    this.grid.rotation.x = Math.PI / 2;
    // Depth offsets: a floor at the same height hides the grid but not the axes, without flicker.
    for (const material of [this.grid.material].flat()) patch(material, BEHIND_SURFACE);
    for (const material of [this.axes.material].flat()) patch(material, BEFORE_SURFACE);
    this.highlight.visible = false;
    this.world.add(this.axes);
    this.scene.add(this.content, this.grid, this.world, this.highlight, this.lights.object);
    this.controls = this.newControls();
    for (const type of ["pointerdown", "wheel", "keydown"])
      holder.addEventListener(type, () => this.renewControls(), { capture: true, passive: true });
    this.canvas.addEventListener("wheel", ({ clientX, clientY }) => this.aim(clientX, clientY), { capture: true, passive: true });
    new ResizeObserver(() => this.resize()).observe(holder);
    this.look("home", []);
    const loop = () => {
      this.draw();
      requestAnimationFrame(loop);
    };
    requestAnimationFrame(loop);
  }

  private newControls(): OrbitControls {
    const controls = new OrbitControls(this.camera, this.canvas);
    this.controlsUp.copy(this.camera.up);
    controls.zoomToCursor = true;
    controls.listenToKeyEvents(this.canvas);
    controls.addEventListener("change", () => {
      this.redraw();
      this.callbacks.moved();
    });
    controls.addEventListener("start", () => (this.placements += 1));
    return controls;
  }

  /** Zoom about the target: by a factor below 1 to come closer. */
  zoom(factor: number): void {
    this.controls.dollyIn(factor);
  }

  /**
   * Move the target along the view to the depth of the geometry at a point of the page, since the wheel moves the camera by a
   * fraction of the target's distance. Over nothing, the camera is not stuck at the target: the distance has a minimum.
   */
  private aim(x: number, y: number): void {
    if (this.camera !== this.perspective) return;
    const { position } = this.camera;
    const forward = this.camera.getWorldDirection(new Vector3());
    const hit = this.pick(x, y);
    const depth = hit ? hit.point.sub(position).dot(forward) : Math.max(this.controls.getDistance(), this.framedDistance / 20);
    this.controls.target.copy(position).addScaledVector(forward, depth);
  }

  redraw(): void {
    this.dirty = true;
  }

  show(object: Object3D, on: boolean): void {
    object.visible = on;
    this.redraw();
  }

  setBackground(css: string, gridColor: string): void {
    this.scene.background = new Color(css);
    for (const material of [this.grid.material].flat()) material.color.set(gridColor);
    this.redraw();
  }

  /** Frame boxes from the current direction. */
  fit(boxes: Box3[]): void {
    if (boxes.length) this.frame(boxes, this.camera.position.clone().sub(this.controls.target).normalize());
  }

  /** Frame boxes from a named direction. */
  look(direction: Direction, boxes: Box3[]): void {
    this.setUp(Z_UP);
    this.frame(boxes.length ? boxes : [DEFAULT_BOX.clone().translate(this.world.position)], new Vector3(...DIRECTIONS[direction]).normalize());
  }

  /** Look at the target from a named direction, at the same distance. */
  turnTo(direction: Direction): void {
    const { eye, target, halfHeight, orthographic } = this.view;
    const offset = new Vector3(...DIRECTIONS[direction]).setLength(new Vector3(...eye).distanceTo(new Vector3(...target)));
    const from = offset.add(new Vector3(...target)).toArray();
    this.placeCamera({ eye: from, target, up: Z_UP.toArray(), ...(orthographic && { halfHeight }) });
  }

  /** The camera in the world. */
  get view(): CameraView {
    const [eye, target] = [this.camera.position, this.controls.target].map((at) => at.clone().add(this.origin).toArray()) as [Vector, Vector];
    const halfHeight = this.halfHeight / this.orthographic.zoom;
    return { eye, target, up: this.camera.up.toArray(), halfHeight, orthographic: this.camera === this.orthographic };
  }

  /** Place the camera in the world. */
  placeCamera(view: CameraView): void {
    const [eye, target, up] = [view.eye, view.target, view.up].map((at) => new Vector3(...at)) as [Vector3, Vector3, Vector3];
    this.setUp(up);
    for (const camera of [this.perspective, this.orthographic]) camera.position.copy(eye).sub(this.origin);
    this.controls.target.copy(target).sub(this.origin);
    this.finishPlacing(view.halfHeight ?? eye.distanceTo(target) * TAN_HALF_FOV);
  }

  /** Carry the camera along by a rigid motion in the world. */
  carry(motion: Matrix4): void {
    const view = moved(this.view, motion);
    this.setUp(new Vector3(...view.up));
    for (const camera of [this.perspective, this.orthographic]) camera.position.set(...view.eye).sub(this.origin);
    this.controls.target.set(...view.target).sub(this.origin);
    this.redraw();
  }

  private setUp(up: Vector3): void {
    for (const camera of [this.perspective, this.orthographic]) camera.up.copy(up);
  }

  /** Turn about the direction that is up, from the next drag on. OrbitControls reads it only in its constructor. */
  private renewControls(): void {
    if (this.controlsUp.equals(this.camera.up)) return;
    const { target } = this.controls;
    this.controls.dispose();
    this.controls = this.newControls();
    this.controls.target.copy(target);
  }

  private finishPlacing(halfHeight: number): void {
    this.placements += 1;
    this.orthographic.zoom = 1;
    this.halfHeight = halfHeight;
    this.resize();
    this.controls.update();
    this.callbacks.moved();
    this.framedDistance = this.controls.getDistance();
    this.scaleGrid(halfHeight);
    this.redraw();
  }

  /** Move the camera to the nearest place from which all boxes are in view, with equal margins. */
  private frame(boxes: Box3[], direction: Vector3): void {
    const { position, target, halfHeight } = frame(boxes, direction, this.camera.up, TAN_HALF_FOV, this.perspective.aspect);
    for (const camera of [this.perspective, this.orthographic]) camera.position.copy(position);
    this.controls.target.copy(target);
    this.finishPlacing(halfHeight);
  }

  /** Set the grid's cells to a power of ten in metres that suits the framed box. */
  private scaleGrid(halfHeight: number): void {
    const cell = 10 ** Math.floor(Math.log10(halfHeight));
    this.grid.scale.setScalar(cell);
    this.axes.scale.setScalar(cell);
  }

  /** Cast shadows within boxes; null: cast none. */
  setShadows(boxes: Box3[] | null): void {
    this.lights.castShadows(boxes);
    this.redraw();
  }

  setOcclusion(on: boolean): void {
    this.occlusion?.dispose();
    this.occlusion = on && this.renderer ? new AmbientOcclusion(this.renderer, this.scene, this.camera) : null;
    this.resize();
  }

  setOrthographic(on: boolean): void {
    const next = on ? this.orthographic : this.perspective;
    if (next === this.camera) return;
    const distance = this.camera.position.distanceTo(this.controls.target);
    if (on) this.halfHeight = distance * TAN_HALF_FOV;
    next.position.copy(this.camera.position);
    this.camera = next;
    this.controls.object = next;
    this.setOcclusion(this.occlusion !== null);
    this.controls.update();
    this.redraw();
  }

  /** Outline a box; null: none. */
  outline(box: Box3 | null): void {
    this.highlight.visible = box !== null && !box.isEmpty();
    if (box) this.highlight.box.copy(box);
    this.redraw();
  }

  /** Return the nearest hit at a point of the page, pixels. */
  pick(x: number, y: number): Intersection | undefined {
    const rect = this.canvas.getBoundingClientRect();
    const point = new Vector2(((x - rect.left) / rect.width) * 2 - 1, 1 - ((y - rect.top) / rect.height) * 2);
    const caster = new Raycaster();
    caster.setFromCamera(point, this.camera);
    const size = this.camera.position.distanceTo(this.controls.target) * 0.01;
    caster.layers.enableAll();
    caster.params.Points.threshold = size;
    caster.params.Line.threshold = size;
    return caster.intersectObject(this.content, true)[0];
  }

  /** Adopt the size of the view on the page. */
  resize(): void {
    const width = Math.max(1, this.holder.clientWidth);
    const height = Math.max(1, this.holder.clientHeight);
    this.renderer?.setSize(width, height);
    this.occlusion?.setSize(width, height, this.renderer?.getPixelRatio() ?? 1);
    this.perspective.aspect = width / height;
    this.perspective.updateProjectionMatrix();
    const half = this.halfHeight;
    this.orthographic.left = (-half * width) / height;
    this.orthographic.right = (half * width) / height;
    this.orthographic.top = half;
    this.orthographic.bottom = -half;
    this.orthographic.updateProjectionMatrix();
    this.redraw();
  }

  /** Scale the clipping planes with the camera's distance, for close-ups and wide views. */
  private updateClippingPlanes(): void {
    const distance = Math.max(this.camera.position.distanceTo(this.controls.target), 1e-4);
    this.perspective.near = distance / 500;
    this.perspective.far = distance * 2000;
    this.orthographic.near = -1000 * distance;
    this.orthographic.far = 1000 * distance;
    this.camera.updateProjectionMatrix();
  }

  /** Move the origin to round coordinates near the view's target. */
  private moveOrigin(): void {
    const shift = this.controls.target.clone().divideScalar(MAX_TARGET_DISTANCE).round().multiplyScalar(MAX_TARGET_DISTANCE);
    this.origin.add(shift);
    for (const point of [this.perspective.position, this.orthographic.position, this.controls.target]) point.sub(shift);
    this.world.position.copy(this.origin).negate();
    this.grid.position.z = -this.origin.z; // near the target, at the world's height 0
    this.controls.update();
    this.callbacks.originMoved();
    this.redraw();
  }

  private draw(): void {
    this.controls.update();
    if (this.controls.target.length() > MAX_TARGET_DISTANCE) this.moveOrigin();
    if (this.dirty && this.renderer) this.drawImage(this.renderer);
    else if (this.dirty && (this.canvas as HTMLImageElement).complete) this.loadImage(this.canvas as HTMLImageElement);
    else if (this.renderer && this.clouds.refine(performance.now())) this.refineClouds(this.renderer);
    else return;
    this.frames += 1;
  }

  /** Show the gateway's image of this view, after the previous one has arrived. */
  private loadImage(image: HTMLImageElement): void {
    this.dirty = false;
    this.scene.updateMatrixWorld();
    this.camera.updateMatrixWorld();
    image.src = `${this.callbacks.imageUrl()}&number=${this.frames}`;
    this.callbacks.drawn();
  }

  private drawImage(renderer: WebGLRenderer): void {
    this.dirty = false;
    this.updateClippingPlanes();
    this.lights.placeHeadlight(this.camera, this.controls.target);
    this.clouds.start(performance.now(), this.occlusion !== null);
    const halfHeight = this.controls.getDistance() * TAN_HALF_FOV;
    this.callbacks.drawing(renderer, halfHeight);
    if (this.occlusion) this.occlusion.render(halfHeight);
    else this.render(renderer);
    this.callbacks.drawn();
  }

  private render(renderer: WebGLRenderer): void {
    const draw = () => renderer.render(this.scene, this.camera);
    const translucent = this.callbacks.isTranslucent();
    if (!translucent) this.linearImage?.dispose();
    if (translucent && this.linearImage) this.linearImage.draw(draw);
    else draw();
  }

  /** Add chunks of point clouds to the image. Its colours and depths are kept. */
  private refineClouds(renderer: WebGLRenderer): void {
    const { mask } = this.camera.layers;
    const { background } = this.scene;
    this.camera.layers.set(CLOUD_LAYER);
    this.scene.background = null; // three.js clears the image to a background, even without autoClear
    renderer.autoClear = renderer.shadowMap.autoUpdate = false;
    this.render(renderer);
    renderer.autoClear = renderer.shadowMap.autoUpdate = true;
    this.scene.background = background;
    this.camera.layers.mask = mask;
  }
}
