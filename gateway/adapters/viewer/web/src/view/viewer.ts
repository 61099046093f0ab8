// The 3D view of a session: applies its updates, follows its options, and does what the page's controls ask for.

import { effect, signal } from "@preact/signals";
import type { Box3 } from "three";
import type { TreeNode } from "../model";
import { type Option, options } from "../options";
import type { Panels } from "../panels/panels";
import type { Click, PageLighting, PageSettings, SceneUpdate, TimeCommand } from "../protocol";
import { isRecorded } from "../recorded/resources";
import type { Session } from "../session";
import { CameraAddress } from "../tools/address";
import { Film } from "../tools/film";
import { Follow } from "../tools/follow";
import { Marks } from "../tools/marks";
import { Measurement } from "../tools/measure";
import { TopView } from "../tools/sideviews";
import { Timeline } from "../tools/timeline";
import type { Direction } from "./camera";
import { Drawing } from "./drawing";
import { Frustum } from "./frustum";
import { HomeView } from "./homeview";
import { Materials } from "./materials";
import { Clickable, onTap } from "./pointer";
import { Stage } from "./stage";
import { backgroundColors, colorsOn } from "./theme";

type Quaternion = [number, number, number, number];

export class Viewer {
  readonly holder = document.createElement("div");
  readonly topView = new TopView();
  readonly stage = new Stage(this);
  readonly materials = new Materials(this.stage);
  readonly drawing = new Drawing(this.session.model, this.materials, this.stage);
  readonly frustum = new Frustum(this.stage.redraw);
  readonly follow = new Follow(this.session.model, () => {
    this.stage.rig.placements += 1; // it is not the home view any more
    this.address.write();
  });
  readonly film = new Film(this.stage.canvas);
  readonly measurement = new Measurement(this.stage.redraw);
  readonly marks = new Marks(this.session.model, this.stage.rig.origin, this.holder);
  readonly timeline = new Timeline(this.report, () => this.address?.write());
  /** Camera whose image is beside the view, in the gateway's syntax; empty: none. */
  readonly sideCamera = signal("");
  /** Rotation of the camera in the world, as a quaternion x, y, z, w. */
  readonly rotation = signal<Quaternion>([0, 0, 0, 1]);
  private readonly home: HomeView = new HomeView(this);
  private readonly address: CameraAddress = new CameraAddress(this.stage.rig, this.follow, this.timeline, () => this.home.isShown);
  private readonly clickable = new Clickable(this);
  private readonly settings = signal<PageSettings>({ kind: "page", background: null, grid: null, home: null, clickable: [] });

  constructor(
    readonly session: Session,
    readonly panels: Panels,
    readonly report: (message: Click | TimeCommand) => void,
  ) {
    const { stage } = this;
    stage.scene.add(this.marks.object);
    stage.world.add(this.frustum.object, this.measurement.object);
    onTap(stage.canvas, (x, y, button) => this.tap(x, y, button));
    this.followOptions();
    this.followGraphicsDevice();
  }

  /** Bounds of what the home view frames. */
  get focusBoxes(): Box3[] {
    return this.drawing.focusBoxes(this.session.model.root);
  }

  attach = (element: Element | null): void => element?.append(this.holder);

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
      for (const material of [this.frustum.object.material, ...this.measurement.materials]) material.color.set(colors.frustum);
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
    if (!stage.renderer)
      graphicsNotice.value = `This browser has no WebGL 2${isRecorded() ? "." : ". These are the gateway's own images of the scene."}`;
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
    const { stage, follow } = this;
    stage.resize(); // the text of an orthographic camera has a width
    this.address.read(({ camera, followed, time }) => {
      this.timeline.open(time);
      if (!camera) return;
      this.home.leave();
      if (camera.orthographic) options.orthographic.shown.value = "on";
      stage.rig.place(camera);
      if (followed) follow.start(followed, true);
      else follow.stop();
      follow.carry(stage.rig);
    });
    // In a window of another shape, for instance on a phone that is turned, the home view stays framed.
    addEventListener("resize", () => {
      if (!this.home.isShown) return;
      stage.resize();
      this.look("home");
    });
  }

  apply(update: SceneUpdate): void {
    const change = this.session.apply(update);
    this.follow.carry(this.stage.rig);
    this.marks.move();
    this.drawing.apply(change);
    this.highlight(this.session.selected.peek());
    if (!this.session.isEmpty.peek()) this.home.followNodes(change.added.length > 0);
    if (change.added.length || change.removed.length) this.placeShadows();
    this.stage.redraw();
  }

  /** Adopt the light of the gateway's images. */
  light(lighting: PageLighting): void {
    this.stage.lights.set(lighting);
    this.materials.renewEnvironment();
    this.placeShadows();
  }

  /** Apply the view settings of a client. */
  configure(next: PageSettings): void {
    if (next.grid !== this.settings.peek().grid) options.grid.shown.value = next.grid === null ? options.grid.own : next.grid ? "on" : "off";
    this.settings.value = next;
    this.clickable.setPaths(next.clickable);
    if (this.home.setCamera(next.home)) this.look("home");
  }

  /** Called after the rig's `origin` has changed. */
  originMoved(): void {
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
    this.stage.lights.castShadows(on ? this.focusBoxes : null);
    this.stage.redraw();
  }

  private tap(x: number, y: number, button: Click["button"]): void {
    const hit = this.stage.pick(x, y);
    const node = hit ? (this.drawing.nodeAt(hit) ?? null) : null;
    const point = hit?.point.add(this.stage.rig.origin).toArray();
    if (this.measurement.points.peek() && button === "left") {
      if (point) this.measurement.add(point);
      return;
    }
    if (point && node) this.clickable.report(node, point, button);
    if (button !== "left") return;
    this.select(node, true);
    this.session.clicked.value = point ?? null;
  }

  select = (node: TreeNode | null, reveal = false): void => {
    this.session.select(node, reveal);
    if (node) this.panels.show("Selection");
  };

  /** Draw a node and all below it as this page has changed them; default: the marks alone. */
  changed = (node?: TreeNode): void => {
    for (const each of node?.subtree() ?? []) this.drawing.refresh(each);
    this.session.changes.value += 1;
    this.stage.redraw();
  };

  /** Frame a node; default: the selection, or everything. */
  fit = (node: TreeNode | null = this.session.selected.peek()): void => {
    this.stage.rig.fit(node ? this.drawing.boxes(node) : this.focusBoxes);
  };

  look = (direction: Direction) => {
    if (direction !== "home") return this.stage.rig.look(direction, this.focusBoxes);
    this.follow.stop();
    this.home.show();
  };

  cameraMoved(): void {
    this.address?.write(); // there is none before the view is complete
  }

  drawn(): void {
    const { camera } = this.stage.rig;
    this.materials.disposeUnused();
    this.marks.placeNames(camera, this.holder.clientWidth, this.holder.clientHeight);
    const rotation = camera.quaternion.toArray() as Quaternion;
    if (String(rotation) !== String(this.rotation.peek())) this.rotation.value = rotation;
  }

  /** Return the bounds of a node in the world, metres. */
  boundsOf = (node: TreeNode): Box3 => this.drawing.bounds(node).translate(this.stage.rig.origin);
}
