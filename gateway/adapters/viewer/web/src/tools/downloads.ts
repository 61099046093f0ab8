// What can be downloaded of the view: the image as it is shown, the gateway's image, and the scene as a file.

import type { Color } from "three";
import { download, saveBlob } from "../files";
import type { Session } from "../session";
import { cameraText } from "../view/camera";
import type { Stage } from "../view/stage";
import type { Marks } from "./marks";
import type { Timeline } from "./timeline";
import type { ViewLight } from "./viewlight";

/** View, scene, moment and light that are downloaded. */
type Source = { stage: Stage; session: Session; timeline: Timeline; viewLight: Pick<ViewLight, "query"> };

/** Return the view as parameters of `/scene.glb`. */
function viewQuery({ stage, session, timeline }: Source): URLSearchParams {
  const { clientWidth: width, clientHeight: height } = stage.holder;
  const { view, perspective } = stage.rig;
  const changed = [...session.model.nodes.values()].filter((node) => node.isShown !== node.visible);
  const paths = (on: boolean) => JSON.stringify(changed.filter((node) => node.isShown === on).map((node) => node.path));
  const camera = cameraText(view, perspective.fov, perspective.aspect);
  const state = timeline.state.peek();
  const time: Record<string, string> = !state || state.mode === "live" ? {} : { time: `${state.position}` };
  return new URLSearchParams({ camera, width: `${width}`, height: `${height}`, hide: paths(false), show: paths(true), ...time });
}

/** Return the parameters of the gateway's image of the view. */
export function imageQuery(source: Source): URLSearchParams {
  const query = viewQuery(source);
  query.set("background", (source.stage.scene.background as Color).getHexString());
  for (const [name, value] of Object.entries(source.viewLight.query)) query.set(name, value);
  return query;
}

export const sceneFile = (source: Source): string => `scene.glb?${viewQuery(source)}`;

/** The address of this page with its scene in one file, at the camera, moment and light of this page's address. */
export const pageFile = (): string => `view/scene.html?${new URLSearchParams({ view: location.hash.slice(1) })}`;

export const rendering = (source: Source): string => `scene/render?${imageQuery(source)}`;

/** Download the view as it is shown; without WebGL, an image of the gateway. */
export function snapshot(source: Source & { marks: Marks }): void {
  const { renderer } = source.stage;
  if (!renderer) return void download(rendering(source), "scenegate.png");
  const { width, height } = renderer.domElement;
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const context = canvas.getContext("2d")!;
  context.drawImage(renderer.domElement, 0, 0);
  source.marks.drawNames(context, renderer.getPixelRatio());
  canvas.toBlob((image) => image && saveBlob(image, "scenegate.png"));
}
