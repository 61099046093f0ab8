// The 3D view: the page's scene with lights, grid and axes. It draws only after a change.

import { AxesHelper, Box3, Box3Helper, Color, EventDispatcher, GridHelper, type Intersection, Object3D, Scene } from "three";
import { CameraRig } from "./camerarig";
import { CloudProgress } from "./cloudprogress";
import { Lights } from "./lights";
import { Materials } from "./materials";
import { newRenderer, Rendering } from "./rendering";
import { BEFORE_SURFACE, BEHIND_SURFACE, patch } from "./shaders";

/** `moved`: the camera has; `originMoved`: the rig's `origin` has; `draw`: an image is about to be drawn; `drawn`: it is. */
type StageEvents = Record<"moved" | "originMoved" | "draw" | "drawn", object>;

export class Stage extends EventDispatcher<StageEvents> {
  readonly holder = document.createElement("div");
  readonly scene = new Scene();
  /** Null without WebGL: `canvas` is an image of the gateway then. */
  readonly renderer = newRenderer();
  readonly rendering = this.renderer && new Rendering(this.renderer, this.scene);
  readonly canvas: HTMLElement = this.renderer?.domElement ?? Object.assign(new Image(), { alt: "", draggable: false });
  readonly lights = new Lights(this.renderer);
  readonly materials = new Materials(this.lights, () => this.redraw());
  readonly grid = new GridHelper(20, 20, 0xffffff, 0xffffff);
  readonly axes = new AxesHelper(0.5);
  readonly rig = new CameraRig(
    this.holder,
    this.canvas,
    () => this.moved(),
    (halfHeight) => this.adapt(halfHeight),
  );
  /** Point clouds of several chunks. */
  readonly clouds = new CloudProgress();
  /** Objects of the scene, which `pick` searches. */
  readonly content = new Object3D();
  /** Objects that are placed in the world: axes, the stereo camera. */
  readonly world = new Object3D();
  private readonly highlight = new Box3Helper(new Box3(), new Color(0xff9500));
  private dirty = true;
  /** Number of frames drawn. */
  frames = 0;

  /** @param imageQuery returns the parameters of the gateway's image of the view */
  constructor(private readonly imageQuery: () => URLSearchParams) {
    super();
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("aria-label", "3D view of the scene");
    this.holder.append(this.canvas);
    this.grid.rotation.x = Math.PI / 2;
    // Depth offsets: a floor at the same height hides the grid but not the axes, without flicker.
    for (const material of [this.grid.material].flat()) patch(material, BEHIND_SURFACE);
    for (const material of [this.axes.material].flat()) patch(material, BEFORE_SURFACE);
    this.highlight.visible = false;
    this.world.add(this.axes);
    this.scene.add(this.content, this.grid, this.world, this.highlight, this.lights.object);
    const aim = ({ clientX, clientY }: WheelEvent) => this.rig.aim(this.pick(clientX, clientY)?.point);
    this.canvas.addEventListener("wheel", aim, { capture: true, passive: true });
    new ResizeObserver(() => this.resize()).observe(this.holder);
    this.rig.look("home", []);
    const loop = () => {
      this.draw();
      requestAnimationFrame(loop);
    };
    requestAnimationFrame(loop);
  }

  redraw = (): void => {
    this.dirty = true;
  };

  private moved(): void {
    this.redraw();
    this.dispatchEvent({ type: "moved" });
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

  setOcclusion(on: boolean): void {
    this.rendering?.setOcclusion(on, this.rig.camera);
    this.resize();
  }

  setOrthographic(on: boolean): void {
    this.rig.setOrthographic(on);
    this.setOcclusion(this.rendering?.hasOcclusion === true);
  }

  /** Outline a box; null: none. */
  outline(box: Box3 | null): void {
    this.highlight.visible = box !== null && !box.isEmpty();
    if (box) this.highlight.box.copy(box);
    this.redraw();
  }

  /** Return the nearest hit at a point of the page, pixels. */
  pick(x: number, y: number): Intersection | undefined {
    return this.rig.rayAt(x, y).intersectObject(this.content, true)[0];
  }

  /** Adopt the size of the view on the page. */
  resize(): void {
    const { clientWidth, clientHeight } = this.holder;
    const [width, height] = [Math.max(1, clientWidth), Math.max(1, clientHeight)];
    this.rendering?.setSize(width, height);
    this.rig.resize(width, height);
    this.redraw();
  }

  /** Set the grid's cells to a power of ten in metres that suits the placed camera. */
  private adapt(halfHeight: number): void {
    const cell = 10 ** Math.floor(Math.log10(halfHeight));
    for (const object of [this.grid, this.axes]) object.scale.setScalar(cell);
    this.resize();
  }

  private draw(): void {
    const { canvas, rendering, rig } = this;
    rig.controls.update();
    if (rig.moveOrigin()) this.placeWorld();
    if (this.dirty && rendering) this.drawImage(rendering);
    else if (this.dirty && canvas instanceof HTMLImageElement && canvas.complete) this.loadImage(canvas);
    else if (rendering && this.clouds.refine()) rendering.refine(rig.camera, this.materials.areTranslucent);
    else return;
    this.frames += 1;
  }

  private placeWorld(): void {
    this.world.position.copy(this.rig.origin).negate();
    this.grid.position.z = -this.rig.origin.z; // near the target, at the world's height 0
    this.dispatchEvent({ type: "originMoved" });
  }

  /** Show the gateway's image of this view, after the previous one has arrived. */
  private loadImage(image: HTMLImageElement): void {
    this.dirty = false;
    this.scene.updateMatrixWorld();
    this.rig.camera.updateMatrixWorld();
    image.src = `view/frame.jpg?${this.imageQuery()}&number=${this.frames}`;
    this.dispatchEvent({ type: "drawn" });
  }

  private drawImage(rendering: Rendering): void {
    const { rig } = this;
    this.dirty = false;
    rig.updateClippingPlanes();
    this.clouds.start(rendering.hasOcclusion);
    this.dispatchEvent({ type: "draw" });
    rendering.draw(rig.camera, rig.halfHeightAtTarget, this.materials.areTranslucent);
    this.dispatchEvent({ type: "drawn" });
  }
}
