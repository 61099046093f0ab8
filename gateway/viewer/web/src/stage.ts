// Camera, controls, light, grid and axes. Draws only after a change.

import {
  AxesHelper,
  Box3,
  Box3Helper,
  Color,
  ColorManagement,
  DirectionalLight,
  GridHelper,
  LinearSRGBColorSpace,
  OrthographicCamera,
  PerspectiveCamera,
  Raycaster,
  Scene,
  Vector2,
  Vector3,
  WebGLRenderer,
  type Intersection,
  type Object3D,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { BEFORE, BEHIND, shiftDepth } from "./depth";

// No conversion between colour spaces, as in the rasterizer's "phong" look.
ColorManagement.enabled = false;

const FOV = 45;
/** Half the view's height over that of the framed box. */
const MARGIN = 1.12;
export type Direction = "home" | "top" | "front" | "side";
const DIRECTIONS: Record<Direction, [number, number, number]> = {
  home: [1, -1.2, 0.8],
  top: [0, -1e-4, 1],
  front: [1, 0, 0],
  side: [0, -1, 0],
};

const Z_UP = new Vector3(0, 0, 1);
export type Button = "left" | "middle" | "right";
/** By the number of MouseEvent.button. */
const BUTTONS: readonly Button[] = ["left", "middle", "right"];

export class Stage {
  readonly scene = new Scene();
  readonly renderer: WebGLRenderer;
  readonly grid = new GridHelper(20, 20, 0xffffff, 0xffffff);
  readonly axes = new AxesHelper(0.5);
  readonly perspective = new PerspectiveCamera(FOV, 1, 0.01, 1000);
  readonly orthographic = new OrthographicCamera(-1, 1, 1, -1, -1000, 1000);
  camera: PerspectiveCamera | OrthographicCamera = this.perspective;
  controls: OrbitControls;
  private readonly light = new DirectionalLight(0xffffff, Math.PI);
  private readonly highlight = new Box3Helper(new Box3(), new Color(0xff9500));
  private dirty = true;
  /** Half the height of the orthographic view, metres. */
  private halfHeight = 1;
  /** Number of frames drawn. */
  frames = 0;

  constructor(
    private readonly holder: HTMLElement,
    private readonly content: Object3D,
  ) {
    this.renderer = new WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.domElement.tabIndex = 0;
    this.renderer.domElement.setAttribute("aria-label", "3D view of the scene");
    holder.append(this.renderer.domElement);
    for (const camera of [this.perspective, this.orthographic]) camera.up.copy(Z_UP);
    this.grid.rotation.x = Math.PI / 2;
    // Depth offsets: a floor at the same height hides the grid but not the axes, without flicker.
    for (const material of [this.grid.material].flat()) shiftDepth(material, BEHIND);
    for (const material of [this.axes.material].flat()) shiftDepth(material, BEFORE);
    this.highlight.visible = false;
    this.scene.add(content, this.grid, this.axes, this.highlight, this.light, this.light.target);
    this.controls = this.newControls();
    new ResizeObserver(() => this.resize()).observe(holder);
    this.look("home", new Box3(new Vector3(-1, -1, 0), new Vector3(1, 1, 1)));
    this.renderer.setAnimationLoop(() => this.draw());
  }

  private newControls(): OrbitControls {
    const controls = new OrbitControls(this.camera, this.renderer.domElement);
    controls.listenToKeyEvents(this.renderer.domElement);
    controls.addEventListener("change", () => this.redraw());
    return controls;
  }

  redraw(): void {
    this.dirty = true;
  }

  show(object: Object3D, on: boolean): void {
    object.visible = on;
    this.redraw();
  }

  /** Call back on clicks and taps, not on drags. */
  onTap(tapped: (x: number, y: number, button: Button) => void): void {
    const canvas = this.renderer.domElement;
    let press = { x: 0, y: 0 };
    canvas.addEventListener("pointerdown", (event) => (press = { x: event.clientX, y: event.clientY }));
    const released = (event: MouseEvent) => {
      const button = BUTTONS[event.button];
      const isDrag = Math.hypot(event.clientX - press.x, event.clientY - press.y) > 5;
      if (button && !isDrag) tapped(event.clientX, event.clientY, button);
    };
    canvas.addEventListener("click", released);
    canvas.addEventListener("auxclick", released);
  }

  setBackground(css: string, gridColor: string): void {
    this.scene.background = new Color(css);
    for (const material of [this.grid.material].flat()) material.color.set(gridColor);
    this.redraw();
  }

  /** Frame a box from the current direction. */
  fit(box: Box3): void {
    if (box.isEmpty()) return;
    this.placeCamera(box, this.camera.position.clone().sub(this.controls.target).normalize());
  }

  /** Frame a box from a named direction. */
  look(direction: Direction, box: Box3): void {
    this.setUp(Z_UP);
    const framed = box.isEmpty() ? new Box3(new Vector3(-1, -1, -1), new Vector3(1, 1, 1)) : box;
    this.placeCamera(framed, new Vector3(...DIRECTIONS[direction]).normalize());
  }

  /** Place the camera. */
  place(eye: Vector3, target: Vector3, up: Vector3): void {
    this.setUp(up);
    for (const camera of [this.perspective, this.orthographic]) camera.position.copy(eye);
    this.controls.target.copy(target);
    this.finishPlacing(eye.distanceTo(target) * Math.tan((FOV * Math.PI) / 360));
  }

  /** Set the direction that is up in the view. OrbitControls reads it only when they are created. */
  private setUp(up: Vector3): void {
    if (this.camera.up.equals(up)) return;
    for (const camera of [this.perspective, this.orthographic]) camera.up.copy(up);
    const { target } = this.controls;
    this.controls.dispose();
    this.controls = this.newControls();
    this.controls.target.copy(target);
  }

  private finishPlacing(halfHeight: number): void {
    this.orthographic.zoom = 1;
    this.halfHeight = halfHeight;
    this.resize();
    this.controls.update();
    this.scaleGrid(halfHeight);
    this.redraw();
  }

  /** Move the camera to the distance at which all corners of the box are in view. */
  private placeCamera(box: Box3, direction: Vector3): void {
    const centre = box.getCenter(new Vector3());
    const right = this.camera.up.clone().cross(direction).normalize();
    const up = direction.clone().cross(right);
    const tangent = Math.tan((FOV * Math.PI) / 360) / MARGIN;
    const { aspect } = this.perspective;
    let distance = 1e-3;
    let halfHeight = 1e-3;
    for (const x of [box.min.x, box.max.x])
      for (const y of [box.min.y, box.max.y])
        for (const z of [box.min.z, box.max.z]) {
          const corner = new Vector3(x, y, z).sub(centre);
          const extent = Math.max(Math.abs(corner.dot(right)) / aspect, Math.abs(corner.dot(up)));
          distance = Math.max(distance, extent / tangent + corner.dot(direction));
          halfHeight = Math.max(halfHeight, extent * MARGIN);
        }
    for (const camera of [this.perspective, this.orthographic]) camera.position.copy(centre).addScaledVector(direction, distance);
    this.controls.target.copy(centre);
    this.finishPlacing(halfHeight);
  }

  /** Set the grid's cells to a power of ten in metres that suits the framed box. */
  private scaleGrid(halfHeight: number): void {
    const cell = 10 ** Math.floor(Math.log10(halfHeight));
    this.grid.scale.setScalar(cell);
    this.axes.scale.setScalar(cell);
  }

  setOrthographic(on: boolean): void {
    const next = on ? this.orthographic : this.perspective;
    if (next === this.camera) return;
    const distance = this.camera.position.distanceTo(this.controls.target);
    if (on) this.halfHeight = distance * Math.tan((FOV * Math.PI) / 360);
    next.position.copy(this.camera.position);
    this.camera = next;
    this.controls.object = next;
    this.resize();
    this.controls.update();
    this.redraw();
  }

  select(box: Box3 | null): void {
    this.highlight.visible = box !== null && !box.isEmpty();
    if (box) this.highlight.box.copy(box);
    this.redraw();
  }

  /** Return the object at a point of the page. */
  pick(x: number, y: number): Intersection | undefined {
    const rect = this.renderer.domElement.getBoundingClientRect();
    const point = new Vector2(((x - rect.left) / rect.width) * 2 - 1, 1 - ((y - rect.top) / rect.height) * 2);
    const caster = new Raycaster();
    caster.setFromCamera(point, this.camera);
    const size = this.camera.position.distanceTo(this.controls.target) * 0.01;
    caster.params.Points.threshold = size;
    caster.params.Line.threshold = size;
    return caster.intersectObject(this.content, true)[0];
  }

  private resize(): void {
    const width = Math.max(1, this.holder.clientWidth);
    const height = Math.max(1, this.holder.clientHeight);
    this.renderer.setSize(width, height);
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

  /** Set clipping planes that follow the camera's distance, for close-ups and wide views. */
  private updateClippingPlanes(): void {
    const distance = Math.max(this.camera.position.distanceTo(this.controls.target), 1e-4);
    this.perspective.near = distance / 500;
    this.perspective.far = distance * 2000;
    this.orthographic.near = -1000 * distance;
    this.orthographic.far = 1000 * distance;
    this.camera.updateProjectionMatrix();
  }

  private draw(): void {
    this.controls.update();
    if (!this.dirty) return;
    this.dirty = false;
    this.updateClippingPlanes();
    this.light.position.copy(this.camera.position);
    this.light.target.position.copy(this.controls.target);
    this.renderer.render(this.scene, this.camera);
    this.frames += 1;
  }
}
