// Camera, controls, light, grid and axes: where the scene stands. Draws only when something changed.

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
  Sphere,
  Vector2,
  Vector3,
  WebGLRenderer,
  type Intersection,
  type Object3D,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

// As the rasterizer's "phong" look: colours are shown as they come.
ColorManagement.enabled = false;

const FOV = 45;
export type Direction = "home" | "top" | "front" | "side";
const DIRECTIONS: Record<Direction, [number, number, number]> = {
  home: [1, -1.2, 0.8],
  top: [0, -1e-4, 1],
  front: [1, 0, 0],
  side: [0, -1, 0],
};

export class Stage {
  readonly scene = new Scene();
  readonly renderer: WebGLRenderer;
  readonly grid = new GridHelper(20, 20);
  readonly axes = new AxesHelper(0.5);
  readonly perspective = new PerspectiveCamera(FOV, 1, 0.01, 1000);
  readonly orthographic = new OrthographicCamera(-1, 1, 1, -1, -1000, 1000);
  camera: PerspectiveCamera | OrthographicCamera = this.perspective;
  readonly controls: OrbitControls;
  private readonly light = new DirectionalLight(0xffffff, Math.PI);
  private readonly highlight = new Box3Helper(new Box3(), new Color(0xff9500));
  private dirty = true;
  /** Frames drawn so far. */
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
    for (const camera of [this.perspective, this.orthographic]) camera.up.set(0, 0, 1);
    this.grid.rotation.x = Math.PI / 2;
    this.highlight.visible = false;
    this.scene.add(content, this.grid, this.axes, this.highlight, this.light, this.light.target);
    this.controls = new OrbitControls(this.camera, this.renderer.domElement);
    this.controls.listenToKeyEvents(this.renderer.domElement);
    this.controls.addEventListener("change", () => this.redraw());
    new ResizeObserver(() => this.resize()).observe(holder);
    this.look("home", new Box3(new Vector3(-1, -1, 0), new Vector3(1, 1, 1)));
    this.renderer.setAnimationLoop(() => this.draw());
  }

  redraw(): void {
    this.dirty = true;
  }

  show(object: Object3D, on: boolean): void {
    object.visible = on;
    this.redraw();
  }

  /** Calls back for clicks and taps, not for drags. */
  onTap(tapped: (x: number, y: number) => void): void {
    const canvas = this.renderer.domElement;
    let press = { x: 0, y: 0 };
    canvas.addEventListener("pointerdown", (event) => (press = { x: event.clientX, y: event.clientY }));
    canvas.addEventListener("click", (event) => {
      if (Math.hypot(event.clientX - press.x, event.clientY - press.y) <= 5) tapped(event.clientX, event.clientY);
    });
  }

  setBackground(css: string, gridColor: string): void {
    this.scene.background = new Color(css);
    for (const material of [this.grid.material].flat()) material.color.set(gridColor);
    this.redraw();
  }

  /** Frames a box from the present direction. */
  fit(box: Box3): void {
    if (box.isEmpty()) return;
    const sphere = box.getBoundingSphere(new Sphere());
    const away = this.camera.position.clone().sub(this.controls.target).normalize();
    this.stand(sphere, away);
  }

  /** Frames a box from a named direction. */
  look(direction: Direction, box: Box3): void {
    const sphere = box.isEmpty() ? new Sphere(new Vector3(), 1) : box.getBoundingSphere(new Sphere());
    this.stand(sphere, new Vector3(...DIRECTIONS[direction]).normalize());
  }

  private stand(sphere: Sphere, away: Vector3): void {
    const radius = Math.max(sphere.radius, 1e-3);
    const aspect = this.perspective.aspect;
    const half = Math.min(FOV / 2, (Math.atan(Math.tan((FOV * Math.PI) / 360) * aspect) * 180) / Math.PI);
    const distance = (1.05 * radius) / Math.sin((half * Math.PI) / 180);
    for (const camera of [this.perspective, this.orthographic])
      camera.position.copy(sphere.center).addScaledVector(away, distance);
    this.perspective.near = Math.max(distance / 1000, 1e-4);
    this.perspective.far = distance * 1000;
    this.orthographic.near = -100 * radius;
    this.orthographic.far = 100 * radius + distance;
    this.orthographic.zoom = 1;
    this.orthographic.userData.halfHeight = radius * 1.05 * Math.max(1, 1 / aspect);
    this.controls.target.copy(sphere.center);
    this.resize();
    this.controls.update();
    this.redraw();
  }

  setOrthographic(on: boolean): void {
    const next = on ? this.orthographic : this.perspective;
    if (next === this.camera) return;
    const distance = this.camera.position.distanceTo(this.controls.target);
    if (on) this.orthographic.userData.halfHeight = distance * Math.tan((FOV * Math.PI) / 360);
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

  /** What lies under a point of the page. */
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
    const half = (this.orthographic.userData.halfHeight as number | undefined) ?? 1;
    this.orthographic.left = (-half * width) / height;
    this.orthographic.right = (half * width) / height;
    this.orthographic.top = half;
    this.orthographic.bottom = -half;
    this.orthographic.updateProjectionMatrix();
    this.redraw();
  }

  private draw(): void {
    this.controls.update();
    if (!this.dirty) return;
    this.dirty = false;
    this.light.position.copy(this.camera.position);
    this.light.target.position.copy(this.controls.target);
    this.renderer.render(this.scene, this.camera);
    this.frames += 1;
  }
}
