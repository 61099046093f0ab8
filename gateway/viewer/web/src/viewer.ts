// The 3D view of a session: applies its updates, follows its options, and does what the page's controls ask for.

import { effect, signal } from "@preact/signals";
import type { Box3, Color } from "three";
import { CameraAddress } from "./address";
import { addressText, cameraText, parseAddress } from "./camera";
import { Clicks } from "./clicks";
import { Drawing } from "./drawing";
import { Follow, type FollowMode } from "./follow";
import type { Direction } from "./framing";
import { Frustum } from "./frustum";
import { Marks } from "./marks";
import { Materials, type PointSize } from "./materials";
import { Measurement } from "./measure";
import type { TreeNode } from "./model";
import { type Option, options } from "./options";
import type { Panels } from "./panels";
import type { Click, PageSettings, SceneUpdate } from "./protocol";
import type { Session } from "./session";
import { Stage } from "./stage";
import { onTap } from "./taps";
import { backgroundColors, colorsOn } from "./theme";
import { TopView } from "./topview";

type Quaternion = [number, number, number, number];

/** Time in which the home view follows the nodes that are added. */
const FRAMING_MS = 2000;

export class Viewer {
  readonly stage: Stage;
  readonly materials: Materials;
  readonly drawing: Drawing;
  readonly frustum: Frustum;
  readonly follow: Follow;
  readonly topView = new TopView();
  /** True: the scene from above is beside the view. */
  readonly hasTopView = signal(false);
  /** Camera whose image is beside the view, in the gateway's syntax; empty: none. */
  readonly sideCamera = signal("");
  private readonly marks: Marks;
  readonly measurement: Measurement;
  /** Rotation of the camera in the world, as a quaternion x, y, z, w. */
  readonly rotation = signal<Quaternion>([0, 0, 0, 1]);
  private readonly address = new CameraAddress(() => this.addressText());
  private readonly clicks: Clicks;
  private readonly settings = signal<PageSettings>({ kind: "page", background: null, grid: null, home: null, clickable: [] });
  /** Time until which the home view follows the first nodes, `performance.now()`; publishers send one after the other. */
  private framingEnds = Infinity;
  /** `stage.placements` after the home view was last framed. */
  private framed: number;
  /** JSON of the last home camera that a client has set. */
  private lastHome = "";

  constructor(
    readonly session: Session,
    readonly panels: Panels,
    private readonly holder: HTMLElement,
    report: (click: Click) => void,
  ) {
    const redraw = () => this.stage.redraw();
    this.stage = new Stage(holder, {
      imageUrl: () => `view/frame.jpg?${this.imageQuery()}`,
      isTranslucent: () => this.materials.areTranslucent,
      drawing: (renderer, halfHeight) => {
        const { scene, controls } = this.stage;
        if (this.hasTopView.peek()) this.topView.draw(renderer, scene, controls.target, halfHeight);
      },
      drawn: () => this.drawn(),
      moved: () => this.address.write(),
      originMoved: () => this.placeAll(),
    });
    const { stage } = this;
    this.framed = stage.placements;
    this.follow = new Follow(session.model);
    this.materials = new Materials(redraw, () => stage.lights.environmentMap);
    this.drawing = new Drawing(session.model, this.materials, stage.clouds, stage.origin, redraw);
    stage.content.add(this.drawing.root);
    this.marks = new Marks(session.model, stage.origin, holder);
    stage.scene.add(this.marks.object);
    this.frustum = new Frustum(redraw);
    this.measurement = new Measurement(redraw);
    stage.world.add(this.frustum.object, this.measurement.object);
    this.clicks = new Clicks(stage, this.drawing, report);
    onTap(stage.canvas, (x, y, button) => this.tap(x, y, button));
    this.followOptions();
    this.followGraphicsDevice();
  }

  /** Follow the display options and the selection. */
  private followOptions(): void {
    const { stage, session, panels } = this;
    const follow = (option: Option<"off" | "on">, set: (on: boolean) => void) => effect(() => set(option.shown.value === "on"));
    follow(options.grid, (on) => stage.show(stage.grid, on));
    follow(options.axes, (on) => stage.show(stage.axes, on));
    follow(options.wireframe, (on) => this.materials.setWireframe(on));
    follow(options.orthographic, (on) => stage.setOrthographic(on));
    follow(options.shadows, () => this.placeShadows());
    follow(options.occlusion, (on) => stage.setOcclusion(on));
    effect(() => {
      document.documentElement.dataset.theme = options.theme.shown.value;
      const { background } = this.settings.value;
      const name = options.background.shown.value;
      const colors = name === "theme" && background ? colorsOn(background) : backgroundColors(name);
      for (const material of [this.frustum.material, ...this.measurement.materials]) material.color.set(colors.frustum);
      stage.setBackground(colors.background, colors.grid);
    });
    effect(() => this.frustum.setShown(session.streaming.value || panels.isActive("Stereo")));
    effect(() => {
      session.changes.value;
      this.marks.refresh();
      this.highlight(session.selected.value);
    });
  }

  /** Say that the graphics device is lost, and come back with it. */
  private followGraphicsDevice(): void {
    const { graphicsNotice } = this.session;
    const { stage } = this;
    if (!stage.renderer) graphicsNotice.value = "This browser has no WebGL 2. These are the gateway's own images of the scene.";
    stage.canvas.addEventListener("webglcontextlost", () => {
      graphicsNotice.value = "The browser has lost its graphics device. The view returns when it is back.";
    });
    stage.canvas.addEventListener("webglcontextrestored", () => {
      stage.lights.forgetEnvironment();
      this.materials.renewEnvironment();
      graphicsNotice.value = "";
      stage.redraw();
    });
  }

  /** Take the camera from the address. Called when the view has its size. */
  followAddress(): void {
    const { stage } = this;
    stage.resize(); // the text of an orthographic camera has a width
    this.address.read((text) => this.placeCamera(text));
    // In a window of another shape, for instance on a phone that is turned, the home view stays framed.
    addEventListener("resize", () => {
      if (stage.placements !== this.framed) return;
      stage.resize();
      this.look("home");
    });
  }

  private placeCamera(text: string): void {
    const { camera, followed } = parseAddress(text, this.stage.perspective.aspect);
    if (!camera) return;
    this.framingEnds = 0;
    if (camera.orthographic) options.orthographic.shown.value = "on";
    this.stage.placeCamera(camera);
    if (followed) this.follow.start(followed, true);
    else this.follow.stop();
    this.carryCamera();
  }

  /** Follow a node with the camera; null: stop. */
  followNode = (node: TreeNode | null, mode: FollowMode = "follow"): void => {
    if (node) this.follow.start({ path: node.path, mode });
    else this.follow.stop();
    this.stage.placements += 1; // it is not the home view any more
    this.address.write();
  };

  setFollowMode = (mode: FollowMode): void => {
    this.follow.setMode(mode);
    this.address.write();
  };

  /** Follow a node, then ride along with it, then stop; without a node, stop. */
  cycleFollow = (node: TreeNode | null = this.session.selected.peek()): void => {
    const mode = this.follow.modeOf(node);
    this.followNode(mode === "ride" ? null : node, mode ? "ride" : "follow");
  };

  /** Move the camera as the node that it follows has moved; while a gizmo's handle is dragged, afterwards. */
  private carryCamera(): void {
    const motion = this.stage.controls.enabled ? this.follow.motion() : null;
    if (motion) this.stage.carry(motion);
  }

  apply(update: SceneUpdate): void {
    const change = this.session.apply(update);
    this.carryCamera();
    this.marks.move();
    this.drawing.apply(change);
    this.highlight(this.session.selected.peek());
    if (!this.session.isEmpty.peek() && (change.added.length || this.framingEnds === Infinity)) this.frameFirstNodes();
    if (change.added.length || change.removed.length) this.placeShadows();
    this.stage.redraw();
  }

  /** Frame the scene while its first nodes arrive, unless the camera was moved meanwhile. */
  private frameFirstNodes(): void {
    const now = performance.now();
    if (this.framingEnds === Infinity) this.framingEnds = now + FRAMING_MS;
    else if (now > this.framingEnds || this.stage.placements !== this.framed) return;
    this.look("home");
  }

  /** Apply the view settings of a client. */
  configure(next: PageSettings): void {
    if (next.grid !== this.settings.peek().grid) options.grid.shown.value = next.grid === null ? options.grid.own : next.grid ? "on" : "off";
    this.settings.value = next;
    this.clicks.setPaths(next.clickable);
    const home = JSON.stringify(next.home);
    const isNew = home !== this.lastHome && !(this.lastHome === "" && this.framingEnds === 0); // a link has its own camera
    this.lastHome = home;
    if (next.home && isNew) this.look("home");
  }

  private placeAll(): void {
    this.drawing.moveAll();
    this.marks.move();
    this.highlight(this.session.selected.peek());
    this.placeShadows();
  }

  private highlight(node: TreeNode | null): void {
    this.stage.outline(node ? this.drawing.bounds(node) : null);
  }

  /** Fit the lamp's shadow map to the scene, if shadows are on. */
  placeShadows(): void {
    const on = options.shadows.shown.peek() === "on";
    this.stage.setShadows(on ? this.drawing.focusBoxes(this.session.model.root) : null);
  }

  private tap(x: number, y: number, button: Click["button"]): void {
    const hit = this.stage.pick(x, y);
    const node = hit ? (this.drawing.nodeAt(hit) ?? null) : null;
    const point = hit?.point.add(this.stage.origin).toArray();
    if (this.measurement.points.peek() && button === "left") {
      if (point) this.measurement.add(point);
      return;
    }
    if (point && node) this.clicks.report(node, point, button);
    if (button !== "left") return;
    this.select(node, true);
    this.session.clicked.value = point ?? null;
  }

  select = (node: TreeNode | null, reveal = false): void => {
    this.session.select(node, reveal);
    if (node) this.panels.show("Selection");
  };

  changed = (node: TreeNode): void => {
    for (const each of node.subtree()) this.drawing.refresh(each);
    this.session.changes.value += 1;
    this.stage.redraw();
  };

  /** Show the marks of nodes as they were chosen. */
  markChanged = (): void => {
    this.session.changes.value += 1;
    this.stage.redraw();
  };

  /** Frame a node; default: the selection, or everything. */
  fit = (node: TreeNode | null = this.session.selected.peek()): void => {
    this.stage.fit(node ? this.drawing.boxes(node) : this.drawing.focusBoxes(this.session.model.root));
  };

  look = (direction: Direction): void => {
    const { home } = this.settings.peek();
    if (direction === "home") this.follow.stop();
    if (direction === "home" && home) this.stage.placeCamera(home);
    else this.stage.look(direction, this.drawing.focusBoxes(this.session.model.root));
    if (direction === "home") this.framed = this.stage.placements;
  };

  turnTo = (direction: Direction): void => this.stage.turnTo(direction);

  private drawn(): void {
    this.materials.disposeUnused();
    this.marks.placeNames(this.stage.camera, this.holder.clientWidth, this.holder.clientHeight);
    const rotation = this.stage.camera.quaternion.toArray() as Quaternion;
    if (String(rotation) !== String(this.rotation.peek())) this.rotation.value = rotation;
  }

  boundsOf = (node: TreeNode): Box3 => this.drawing.bounds(node).translate(this.stage.origin);

  pointSize = (size: PointSize): void => this.materials.setPointSize(size);

  file = (): string => `scene.glb?${this.viewQuery()}`;

  rendering = (): string => `scene/render?${this.imageQuery()}`;

  /** Download the view as it is shown; without WebGL, an image of the gateway. */
  snapshot = (): void => {
    const save = (href: string) => Object.assign(document.createElement("a"), { href, download: "scenegate.png" }).click();
    if (!this.stage.renderer) save(this.rendering());
    this.stage.renderer?.domElement.toBlob((image) => {
      if (!image) return;
      const url = URL.createObjectURL(image);
      save(url);
      setTimeout(() => URL.revokeObjectURL(url), 10_000);
    });
  };

  /** Return this view's camera in the gateway's syntax. */
  private cameraText(view = this.stage.view): string {
    return cameraText(view, this.stage.perspective.fov, this.stage.perspective.aspect);
  }

  private addressText(): string {
    if (this.stage.placements === this.framed && !this.follow.followed.peek()) return "";
    return addressText(this.cameraText(this.follow.relative(this.stage.view)), this.follow.followed.peek());
  }

  /** Return this view as parameters of `/scene.glb`. */
  private viewQuery(): URLSearchParams {
    const { clientWidth: width, clientHeight: height } = this.holder;
    const changed = [...this.session.model.nodes.values()].filter(({ shown, visible }) => (shown ?? visible) !== visible);
    const paths = (on: boolean) => JSON.stringify(changed.filter((node) => node.isShown === on).map((node) => node.path));
    const camera = this.cameraText();
    return new URLSearchParams({ camera, width: `${width}`, height: `${height}`, hide: paths(false), show: paths(true) });
  }

  /** Return the parameters of the gateway's image of this view. */
  private imageQuery(): URLSearchParams {
    const query = this.viewQuery();
    query.set("background", (this.stage.scene.background as Color).getHexString());
    return query;
  }
}
