// What can be downloaded of the view: the image as it is shown, the gateway's image, and the scene as a file.

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

/** Download the view as it is shown; without WebGL, an image of the gateway. */
export function snapshot(viewer: Viewer) {
  const save = (href: string) => Object.assign(document.createElement("a"), { href, download: "scenegate.png" }).click();
  const { renderer } = viewer.stage;
  if (!renderer) return save(rendering(viewer));
  const { width, height } = renderer.domElement;
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const context = canvas.getContext("2d")!;
  context.drawImage(renderer.domElement, 0, 0);
  viewer.marks.drawNames(context, renderer.getPixelRatio());
  canvas.toBlob((image) => {
    if (!image) return;
    const url = URL.createObjectURL(image);
    save(url);
    setTimeout(() => URL.revokeObjectURL(url), 10_000);
  });
}
