// What can be downloaded of the view: the image as it is shown, the gateway's image, and the scene as a file.

import { signal } from "@preact/signals";
import type { Color } from "three";
import { cameraText } from "./camera";
import type { Viewer } from "./viewer";

/** Return the view as parameters of `/scene.glb`. */
function viewQuery({ stage, session, holder, timeline }: Viewer): URLSearchParams {
  const { clientWidth: width, clientHeight: height } = holder;
  const { view, perspective } = stage.rig;
  const changed = [...session.model.nodes.values()].filter((node) => node.isShown !== node.visible);
  const paths = (on: boolean) => JSON.stringify(changed.filter((node) => node.isShown === on).map((node) => node.path));
  const camera = cameraText(view, perspective.fov, perspective.aspect);
  const state = timeline.state.peek();
  const time: Record<string, string> = !state || state.mode === "live" ? {} : { time: `${state.position}` };
  return new URLSearchParams({ camera, width: `${width}`, height: `${height}`, hide: paths(false), show: paths(true), ...time });
}

/** Return the parameters of the gateway's image of the view. */
export function imageQuery(viewer: Viewer): URLSearchParams {
  const query = viewQuery(viewer);
  query.set("background", (viewer.stage.scene.background as Color).getHexString());
  return query;
}

export const sceneFile = (viewer: Viewer): string => `scene.glb?${viewQuery(viewer)}`;

/** The address of this page with its scene in one file, at the camera and moment of this page's address. */
export const pageFile = (): string => `view/scene.html?${new URLSearchParams({ view: location.hash.slice(1) })}`;

export const rendering = (viewer: Viewer): string => `scene/render?${imageQuery(viewer)}`;

/** Sentence about a download that failed, for some seconds. */
export const downloadProblem = signal("");
const PROBLEM_MS = 15_000;

function saveAs(href: string, fileName: string): void {
  Object.assign(document.createElement("a"), { href, download: fileName }).click();
}

export function saveBlob(blob: Blob, fileName: string): void {
  const url = URL.createObjectURL(blob);
  saveAs(url, fileName);
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}

/** Download a file of the gateway. If that fails, its sentence is in `downloadProblem`. */
export async function download(url: string, fileName: string): Promise<void> {
  if (/^(data|blob):/.test(url)) return saveAs(url, fileName);
  const response = await fetch(url).catch(() => null);
  if (response?.ok) return saveBlob(await response.blob(), fileName);
  const text = (await response?.text().catch(() => "")) ?? "";
  const sentence = text.startsWith("{") ? JSON.parse(text).detail : text;
  downloadProblem.value = `${fileName}: ${response ? sentence || response.statusText : "the gateway does not respond"}`;
  setTimeout(() => (downloadProblem.value = ""), PROBLEM_MS);
}

/** Download the view as it is shown; without WebGL, an image of the gateway. */
export function snapshot(viewer: Viewer) {
  const { renderer } = viewer.stage;
  if (!renderer) return void download(rendering(viewer), "scenegate.png");
  const { width, height } = renderer.domElement;
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const context = canvas.getContext("2d")!;
  context.drawImage(renderer.domElement, 0, 0);
  viewer.marks.drawNames(context, renderer.getPixelRatio());
  canvas.toBlob((image) => image && saveBlob(image, "scenegate.png"));
}
