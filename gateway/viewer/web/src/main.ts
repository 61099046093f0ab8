import { Box3, type Color, type Vector3 } from "three";
import "./style.css";
import { Clicks } from "./clicks";
import { Connection } from "./connection";
import { DetailsPanel } from "./detailspanel";
import { h } from "./dom";
import { Drawing } from "./drawing";
import { Frustum } from "./frustum";
import { EmptyState } from "./emptystate";
import { Layout } from "./layout";
import { Lightbox } from "./lightbox";
import { Materials } from "./materials";
import { Model, type TreeNode } from "./model";
import type { Message, PageSettings, Path, SceneUpdate, Status } from "./protocol";
import { RendersPanel } from "./renderspanel";
import { SensorsPanel } from "./sensorspanel";
import { Stage, type CameraView, type Direction } from "./stage";
import { StatusBar } from "./statusbar";
import { Tabs } from "./tabs";
import { isOn, keep, keepInTab, keptInTab } from "./options";
import { backgroundColors, colorsOn, startingBackground, startingTheme, type Theme } from "./theme";
import { toolbar } from "./toolbar";
import { TreePanel } from "./treepanel";

/** Time in which the home view follows the nodes that are added. */
const FRAMING_MS = 2000;

const model = new Model();
const redraw = () => stage.redraw();
const stageElement = h("main", { class: "stage" });
const stage: Stage = new Stage(
  stageElement,
  () => `view/frame.jpg?${imageQuery()}`,
  () => materials.areTranslucent,
  () => materials.disposeUnused(),
  () => {
    drawing.moveAll();
    highlight();
    placeShadows();
  },
);
const materials = new Materials(redraw, () => stage.lights.environmentMap);
const drawing = new Drawing(model, materials, stage.clouds, stage.origin, redraw);
stage.content.add(drawing.root);
const frustum = new Frustum(redraw);
stage.world.add(frustum.object);
const status = new StatusBar();
const lightbox = new Lightbox();
const hint = h("p", { class: "hint", role: "status", hidden: true });
const emptyState = new EmptyState();
stageElement.append(hint, emptyState.element);

let selected: TreeNode | null = null;
/** Path of a selected node that was removed: it is selected again when it is published. */
let awaited: Path | null = null;
let updates = 0;
/** True while clients stream images of the stereo camera. */
let streaming = false;
/** True after the stereo panel has been opened for the first stream. */
let stereoPanelOpened = false;
/** Time until which the home view follows the first nodes, `performance.now()`; publishers send one after the other. */
let framingEnds = Infinity;
/** `stage.placements` after the home view was last framed. */
let framed = stage.placements;
let background = startingBackground();
let settings: PageSettings = { kind: "page", background: null, grid: null, home: null, clickable: [] };
/** JSON of the last home camera that a client has set. */
let lastHome = "";

const tree = new TreePanel(model, select, refreshBelow, fit);
const details = new DetailsPanel({
  boundsOf: (node) => drawing.bounds(node).translate(stage.origin),
  changed: refreshBelow,
  fit,
  close: () => select(null),
});
const sensors = new SensorsPanel(lightbox);
const renders = new RendersPanel(lightbox);
const tabs = new Tabs({ Selection: details.element, Stereo: sensors.element, Renders: renders.element }, updateActivePanels);
const chosen = {
  background,
  theme: startingTheme(),
  grid: isOn("grid", true),
  axes: isOn("axes", true),
  wireframe: isOn("wireframe", false),
  orthographic: isOn("orthographic", false),
  shadows: isOn("shadows", false),
  occlusion: isOn("occlusion", false),
  shortcuts: isOn("shortcuts", true),
};
const bar = toolbar(
  {
    panel: (side) => layout.toggle(side),
    look,
    fit: () => fit(selected),
    orthographic: (on) => stage.setOrthographic(on),
    grid: (on) => stage.show(stage.grid, on),
    axes: (on) => stage.show(stage.axes, on),
    wireframe: (on) => materials.setWireframe(on),
    shadows: (on) => {
      chosen.shadows = on;
      placeShadows();
    },
    occlusion: (on) => stage.setOcclusion(on),
    shortcuts: (on) => (chosen.shortcuts = on),
    pointSize: (pixels) => materials.setPointSize(pixels),
    background: (name) => {
      keep("background", name);
      background = name;
      showBackground();
    },
    theme: (name) => {
      keep("theme", name);
      setTheme(name);
    },
    snapshot,
    file: () => `scene.glb?${viewQuery()}`,
    rendering: () => `scene/render?${imageQuery()}`,
  },
  chosen,
);
const layout = new Layout(tree.element, stageElement, tabs.element, bar, () => updateActivePanels());

/** Activate the visible panel: panels send requests to the gateway only while they are active. */
function updateActivePanels(): void {
  const visible = layout?.isOpen("right") ? tabs.current : "";
  sensors.setActive(visible === "Stereo");
  renders.setActive(visible === "Renders");
  frustum.setShown(streaming || visible === "Stereo");
}

/** Show the stereo camera while clients stream its images, and open its panel for the first stream. */
function showStreams(message: Status): void {
  const before = streaming;
  streaming = (message.facts ?? []).some(({ name, value }) => name === "streams" && Number(value) > 0);
  if (streaming === before) return;
  if (streaming && !stereoPanelOpened) {
    stereoPanelOpened = true;
    tabs.show("Stereo");
    layout.openIfWide("right");
  }
  updateActivePanels();
}

function select(node: TreeNode | null): void {
  awaited = null;
  showSelection(node);
  if (!node) return;
  tabs.show("Selection");
  layout.openIfWide("right");
}

function showSelection(node: TreeNode | null): void {
  selected = node;
  tree.select(node);
  details.show(node, awaited);
  highlight();
}

/** Select the node at the path of the selected one, after either was removed or added. */
function followSelection(): void {
  if (selected && model.nodes.get(selected.id) !== selected) awaited = selected.path;
  if (!awaited) return highlight();
  const node = model.find(awaited);
  if (node === selected) return;
  if (node) awaited = null;
  showSelection(node);
}

function highlight(): void {
  stage.outline(selected ? drawing.bounds(selected) : null);
}

function refreshBelow(node: TreeNode): void {
  for (const each of node.subtree()) drawing.refresh(each);
  highlight();
  redraw();
}

/** Fit the lamp's shadow map to the scene, if shadows are on. */
function placeShadows(): void {
  stage.setShadows(chosen.shadows ? drawing.focusBoxes(model.root) : null);
}

function fit(node: TreeNode | null): void {
  stage.fit(node ? drawing.boxes(node) : drawing.focusBoxes(model.root));
}

function look(direction: Direction): void {
  if (direction === "home" && settings.home) stage.placeCamera(settings.home);
  else stage.look(direction, drawing.focusBoxes(model.root));
  if (direction === "home") framed = stage.placements;
}

function receive(message: Message): void {
  switch (message.kind) {
    case "update":
      update(message);
      connection.acknowledge();
      break;
    case "mesh":
      model.meshes.set(message.id, message);
      break;
    case "forget":
      drawing.forget(message.meshes);
      break;
    case "rig":
      frustum.show(message);
      break;
    case "page":
      showSettings(message);
      break;
    case "status":
      status.show(message);
      showStreams(message);
      renders.announce(message);
      break;
  }
}

function update(message: SceneUpdate): void {
  const change = model.apply(message);
  drawing.apply(change);
  updates += 1;
  if (change.added.length || change.removed.length || change.changed.size) tree.update();
  followSelection();
  const empty = model.root.children.size === 0 && !model.root.parts;
  if (!empty && (change.added.length || framingEnds === Infinity)) frameFirstNodes();
  if (change.added.length || change.removed.length) placeShadows();
  emptyState.setShown(empty);
  showConnectionHint("");
  redraw();
}

/** Frame the scene while its first nodes arrive, unless the camera was moved meanwhile. */
function frameFirstNodes(): void {
  const now = performance.now();
  if (framingEnds === Infinity) framingEnds = now + FRAMING_MS;
  else if (now > framingEnds || stage.placements !== framed) return;
  look("home");
}

/** Keep the home view framed in a window of another shape, for instance on a phone that is turned. */
addEventListener("resize", () => {
  if (stage.placements !== framed) return;
  stage.resize();
  look("home");
});

function showSettings(next: PageSettings): void {
  const gridChanged = next.grid !== settings.grid;
  settings = next;
  clicks.setPaths(next.clickable);
  showBackground();
  if (gridChanged) bar.setGrid(next.grid ?? isOn("grid", true));
  const home = JSON.stringify(next.home);
  if (next.home && home !== lastHome) {
    lastHome = home;
    look("home");
  }
}

/** Message about the connection. */
let connectionHint = { text: "", where: "centre" };
/** Message about the graphics device. */
let graphicsHint = stage.renderer ? "" : "This browser has no WebGL 2. These are the gateway's own images of the scene.";

/** Show a message about the connection until the next one. */
function showConnectionHint(text: string, where: "centre" | "foot" = "centre"): void {
  connectionHint = { text, where };
  showHint();
}

function showHint(): void {
  hint.textContent = connectionHint.text || graphicsHint;
  hint.hidden = hint.textContent === "";
  hint.classList.toggle("centre", connectionHint.text !== "" && connectionHint.where === "centre");
}

const connection = new Connection(receive, (state, reason) => {
  status.connected(state, reason);
  if (state === "open") {
    drawing.reset();
    sensors.connected();
    renders.connected();
    showConnectionHint("Waiting for the scene …");
  } else if (model.revision === 0) showConnectionHint(reason || "The gateway does not respond; this page keeps trying.");
  else showConnectionHint(reason || "The gateway does not respond; this is the scene as it was.", "foot");
});

const clicks = new Clicks(stage, drawing, (click) => connection.click(click));

function setTheme(name: Theme): void {
  document.documentElement.dataset.theme = name;
  showBackground();
}

function showBackground(): void {
  const colors = background === "theme" && settings.background ? colorsOn(settings.background) : backgroundColors(background);
  frustum.material.color.set(colors.frustum);
  stage.setBackground(colors.background, colors.grid);
}

/** Return this view's camera in the gateway's syntax. */
function cameraText(): string {
  const text = (v: Vector3) => v.toArray().map((x) => x.toFixed(5)).join(",");
  const at = (v: Vector3) => text(v.clone().add(stage.origin));
  const { camera, perspective, orthographic } = stage;
  const size = camera === perspective ? `fovy=${perspective.fov}` : `xmag=${(orthographic.right / orthographic.zoom).toPrecision(9)}`;
  return `eye=${at(camera.position)};target=${at(stage.controls.target)};up=${text(camera.up)};${size}`;
}

/** Return this view as parameters of `/scene.glb`. */
function viewQuery(): URLSearchParams {
  const { clientWidth: width, clientHeight: height } = stageElement;
  const changed = [...model.nodes.values()].filter(({ shown, visible }) => (shown ?? visible) !== visible);
  const paths = (on: boolean) => JSON.stringify(changed.filter((node) => node.isShown === on).map((node) => node.path));
  return new URLSearchParams({ camera: cameraText(), width: `${width}`, height: `${height}`, hide: paths(false), show: paths(true) });
}

/** Return the parameters of the gateway's image of this view. */
function imageQuery(): URLSearchParams {
  const query = viewQuery();
  query.set("background", (stage.scene.background as Color).getHexString());
  return query;
}

/** Download the view as it is shown; without WebGL, an image of the gateway. */
function snapshot(): void {
  const save = (href: string) => h("a", { href, download: "scenegate.png" }).click();
  if (!stage.renderer) return save(`scene/render?${imageQuery()}`);
  stage.renderer.domElement.toBlob((image) => {
    if (!image) return;
    const url = URL.createObjectURL(image);
    save(url);
    setTimeout(() => URL.revokeObjectURL(url), 10_000);
  });
}

document.querySelector("#app")?.append(bar.element, layout.element, status.element, lightbox.element);
setTheme(chosen.theme);
tabs.show("Stereo");
layout.start();

/** The camera, and the home camera that a client had set, are kept until the tab is closed, unless it is the home view. */
interface KeptView extends CameraView {
  home: string;
}
const keptView = keptInTab<KeptView>("view");
if (keptView) {
  lastHome = keptView.home;
  framingEnds = 0;
  stage.placeCamera(keptView);
}
addEventListener("pagehide", () => keepInTab("view", stage.placements === framed ? null : { ...stage.view, home: lastHome }));

stage.canvas.addEventListener("webglcontextlost", () => {
  graphicsHint = "The browser has lost its graphics device. The view returns when it is back.";
  showHint();
});
stage.canvas.addEventListener("webglcontextrestored", () => {
  stage.lights.forgetEnvironment();
  materials.renewEnvironment();
  graphicsHint = "";
  showHint();
  redraw();
});

stage.onTap((x, y, button) => {
  const hit = stage.pick(x, y);
  const node = hit ? (drawing.nodeAt(hit) ?? null) : null;
  if (hit && node) clicks.report(node, hit.point.add(stage.origin).toArray(), button);
  if (button !== "left") return;
  select(node);
  if (node) tree.select(node, true);
});

const KEYS: Record<string, () => void> = {
  f: () => fit(selected),
  h: () => look("home"),
  1: () => look("top"),
  2: () => look("front"),
  3: () => look("side"),
  "+": () => stage.zoom(0.8),
  "=": () => stage.zoom(0.8),
  "-": () => stage.zoom(1.25),
  t: () => layout.toggle("left"),
  s: () => layout.toggle("right"),
  Escape: () => (layout.closeDrawers() ? undefined : select(null)),
};
addEventListener("keydown", (event) => {
  if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || lightbox.isOpen) return;
  if (event.target instanceof HTMLInputElement || event.target instanceof HTMLSelectElement) return;
  // Assistive programs type single characters by mistake: they can be switched off where the view does not have the focus.
  const isCharacter = event.key.length === 1;
  if (isCharacter && !chosen.shortcuts && event.target !== stage.canvas) return;
  KEYS[isCharacter ? event.key.toLowerCase() : event.key]?.();
});

let framesBefore = 0;
setInterval(() => {
  status.tick(stage.frames - framesBefore, updates, model.nodes.size - 1, model.revision);
  framesBefore = stage.frames;
  if (updates && chosen.shadows) placeShadows(); // the scene may have moved
  updates = 0;
  if (document.hidden) materials.disposeUnused(); // nothing is drawn
  details.update();
}, 1000);

// For tests and the console.
Object.assign(window, { scenegate: { model, drawing, stage, frustum, select, fit, Box3 } });
