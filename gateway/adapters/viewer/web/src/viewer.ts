// A session and its 3D view: applies updates, follows options, and does what the controls of the page ask for.

import { effect, signal } from "@preact/signals";
import type { Box3 } from "three";
import type { TreeNode } from "./model";
import { type Option, options } from "./options";
import type { Click, PageLighting, PageSettings, SceneUpdate, TimeCommand, Vector } from "./protocol";
import { isRecorded } from "./resources";
import { Session } from "./session";
import { CameraAddress } from "./tools/address";
import { imageQuery } from "./tools/downloads";
import { Film } from "./tools/film";
import { Follow } from "./tools/follow";
import { Marks } from "./tools/marks";
import { Measurement } from "./tools/measure";
import { Timeline } from "./tools/timeline";
import { TopView } from "./tools/topview";
import { ViewLight } from "./tools/viewlight";
import type { Direction } from "./view/camera";
import { Drawing } from "./view/drawing";
import { Frustum } from "./view/frustum";
import { HomeView } from "./view/homeview";
import { Clickable, onTap } from "./view/pointer";
import { Stage } from "./view/stage";
import { backgroundColors, colorsOn } from "./view/theme";

type Quaternion = [number, number, number, number];

export class Viewer {
  readonly session = new Session();
  readonly stage: Stage = new Stage(() => imageQuery(this));
  readonly topView = new TopView();
  readonly drawing = new Drawing(this.session.model, this.stage);
  readonly viewLight = new ViewLight(
    (change) => {
      this.stage.lights.adapt(change);
      this.followLights();
    },
    () => this.address.write(),
  );
  readonly frustum = new Frustum(this.stage.redraw);
  readonly follow = new Follow(this.session.model, () => {
    this.stage.rig.placements += 1; // it is not the home view any more
    this.address.write();
  });
  readonly film = new Film(this.stage.canvas);
  readonly measurement = new Measurement(this.stage.redraw);
  readonly marks = new Marks(this.session.model, this.stage.rig.origin, this.stage.holder);
  readonly timeline: Timeline;
  /** Camera whose image is beside the view, in the gateway's syntax; empty: none. */
  readonly sideCamera = signal("");
  /** Rotation of the camera in the world, as a quaternion x, y, z, w. */
  readonly rotation = signal<Quaternion>([0, 0, 0, 1]);
  private readonly home = new HomeView(this.stage.rig, () => this.focusBoxes());
  private readonly address: CameraAddress;
  private readonly clickable: Clickable;
  private readonly settings = signal<PageSettings>({ kind: "page", background: null, grid: null, home: null, clickable: [] });

  /** @param selected called when the visitor has selected a node */
  constructor(
    report: (message: Click | TimeCommand) => void,
    private readonly selected: () => void,
  ) {
    const { stage } = this;
    const { canvas, rig } = stage;
    const writeAddress = () => this.address.write();
    this.timeline = new Timeline(report, writeAddress);
    this.address = new CameraAddress(rig, this.follow, this.timeline, this.viewLight, () => this.home.isShown);
    this.clickable = new Clickable(canvas, (x, y) => this.hitAt(x, y).node, report);
    stage.scene.add(this.marks.object);
    stage.world.add(this.frustum.object, this.measurement.object);
    stage.addEventListener("moved", writeAddress);
    stage.addEventListener("originMoved", () => this.originMoved());
    stage.addEventListener("draw", () => {
      this.frustum.seenFrom(rig.camera.position.clone().add(rig.origin));
      this.topView.draw(stage);
    });
    stage.addEventListener("drawn", () => this.drawn());
    onTap(canvas, (x, y, button) => this.tap(x, y, button));
    this.followOptions();
    this.followGraphicsDevice();
  }

  /** Return the bounds of what the home view frames. */
  private focusBoxes(): Box3[] {
    return this.drawing.focusBoxes(this.session.model.root);
  }

  attach = (element: Element | null): void => element?.append(this.stage.holder);

  /** Follow the display options and the selection. */
  private followOptions(): void {
    const { stage, session } = this;
    const follow = (option: Option<"off" | "on">, set: (on: boolean) => void) => effect(() => set(option.shown.value === "on"));
    follow(options.grid, (on) => stage.show(stage.grid, on));
    follow(options.axes, (on) => stage.show(stage.axes, on));
    follow(options.wireframe, (on) => this.stage.materials.setWireframe(on));
    follow(options.orthographic, (on) => stage.setOrthographic(on));
    follow(options.shadows, () => this.placeShadows());
    follow(options.occlusion, (on) => stage.setOcclusion(on));
    effect(() => {
      const { value: theme } = options.theme.shown;
      document.documentElement.dataset.theme = theme;
      const { background } = this.settings.value;
      const name = options.background.shown.value;
      const colors = name === "theme" && background ? colorsOn(background) : backgroundColors(name, theme);
      for (const material of [this.frustum.object.material, ...this.measurement.materials]) material.color.set(colors.frustum);
      stage.setBackground(colors.background, colors.grid);
    });
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
      this.stage.materials.renewEnvironment();
      graphicsNotice.value = "";
      stage.redraw();
    });
  }

  /** Take the view from the address. Called when the view has its size. */
  followAddress(): void {
    const { stage, follow } = this;
    stage.resize(); // the text of an orthographic camera has a width
    this.address.read(({ camera, followed, time, light }) => {
      this.timeline.open(time);
      this.viewLight.change.value = light;
      if (!camera) return;
      this.home.leave();
      if (camera.orthographic) options.orthographic.shown.value = "on";
      stage.rig.place(camera);
      if (followed) follow.start(followed, true);
      else follow.stop();
      follow.carry(stage.rig);
    });
    // In a view of another shape, as on a phone that is turned or beside panels that open, the home view stays framed.
    new ResizeObserver(() => {
      if (!this.home.isShown) return;
      stage.resize();
      this.look("home");
    }).observe(stage.holder);
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
    this.viewLight.own.value = this.stage.lights.ownAngles;
    this.followLights();
  }

  private followLights(): void {
    this.stage.materials.renewEnvironment();
    this.placeShadows();
  }

  /** Apply the view settings of a client. */
  configure(next: PageSettings): void {
    if (next.grid !== this.settings.peek().grid) options.grid.shown.value = next.grid === null ? options.grid.own : next.grid ? "on" : "off";
    this.settings.value = next;
    this.clickable.setPaths(next.clickable);
    if (this.home.setCamera(next.home)) this.look("home");
  }

  private originMoved(): void {
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
    this.stage.lights.castShadows(on ? this.focusBoxes() : null);
    this.stage.redraw();
  }

  /** Return what is at a point of the page, pixels: the node, and the point of the world. */
  private hitAt(x: number, y: number): { node?: TreeNode; point?: Vector } {
    const hit = this.stage.pick(x, y);
    return hit ? { node: this.drawing.nodeAt(hit), point: hit.point.add(this.stage.rig.origin).toArray() } : {};
  }

  private tap(x: number, y: number, button: Click["button"]): void {
    const { node, point } = this.hitAt(x, y);
    if (this.measurement.points.peek() && button === "left") {
      if (point) this.measurement.add(point);
      return;
    }
    if (point && node) this.clickable.report(node, point, button);
    if (button !== "left") return;
    this.select(node ?? null, true);
    this.session.clicked.value = point ?? null;
  }

  select = (node: TreeNode | null, reveal = false): void => {
    this.session.select(node, reveal);
    if (node) this.selected();
  };

  /** Draw a node and all below it as this page has changed them; default: the marks alone. */
  changed = (node?: TreeNode): void => {
    for (const each of node?.subtree() ?? []) this.drawing.refresh(each);
    this.session.changes.value += 1;
    this.stage.redraw();
  };

  /** Frame a node; default: the selection, or everything. */
  fit = (node: TreeNode | null = this.session.selected.peek()): void => {
    this.stage.rig.fit(node ? this.drawing.boxes(node) : this.focusBoxes());
  };

  look = (direction: Direction) => {
    if (direction !== "home") return this.stage.rig.look(direction, this.focusBoxes());
    this.follow.stop();
    this.home.show();
  };

  private drawn(): void {
    const { holder, materials, rig } = this.stage;
    const { camera } = rig;
    materials.disposeUnused();
    this.marks.placeNames(camera, holder.clientWidth, holder.clientHeight);
    const rotation = camera.quaternion.toArray() as Quaternion;
    if (String(rotation) !== String(this.rotation.peek())) this.rotation.value = rotation;
  }

  /** Return the bounds of a node in the world, metres. */
  boundsOf = (node: TreeNode): Box3 => this.drawing.bounds(node).translate(this.stage.rig.origin);
}
