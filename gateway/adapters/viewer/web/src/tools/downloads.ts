// What can be downloaded of the view: the image as it is shown, the gateway's image, and the scene as a file.

import type { Color } from "three";
import { download, saveBlob } from "../files";
import type { Model } from "../model";
import { cameraText } from "../view/camera";
import type { Stage } from "../view/stage";
import type { Marks } from "./marks";
import type { Timeline } from "./timeline";

/** The address of this page with its scene in one file, at the camera and moment of this page's address. */
export const pageFile = (): string => `view/scene.html?${new URLSearchParams({ view: location.hash.slice(1) })}`;

export class Downloads {
  constructor(
    private readonly stage: Stage,
    private readonly model: Model,
    private readonly timeline: Timeline,
    private readonly marks: Marks,
  ) {}

  /** Return the view as parameters of `/scene.glb`. */
  private viewQuery(): URLSearchParams {
    const { clientWidth: width, clientHeight: height } = this.stage.holder;
    const { view, perspective } = this.stage.rig;
    const changed = [...this.model.nodes.values()].filter((node) => node.isShown !== node.visible);
    const paths = (on: boolean) => JSON.stringify(changed.filter((node) => node.isShown === on).map((node) => node.path));
    const camera = cameraText(view, perspective.fov, perspective.aspect);
    const state = this.timeline.state.peek();
    const time: Record<string, string> = !state || state.mode === "live" ? {} : { time: `${state.position}` };
    return new URLSearchParams({ camera, width: `${width}`, height: `${height}`, hide: paths(false), show: paths(true), ...time });
  }

  /** Return the parameters of the gateway's image of the view. */
  imageQuery(): URLSearchParams {
    const query = this.viewQuery();
    query.set("background", (this.stage.scene.background as Color).getHexString());
    return query;
  }

  sceneFile = (): string => `scene.glb?${this.viewQuery()}`;
  rendering = (): string => `scene/render?${this.imageQuery()}`;

  /** Download the view as it is shown; without WebGL, an image of the gateway. */
  snapshot = (): void => {
    const { renderer } = this.stage;
    if (!renderer) return void download(this.rendering(), "scenegate.png");
    const { width, height } = renderer.domElement;
    const canvas = Object.assign(document.createElement("canvas"), { width, height });
    const context = canvas.getContext("2d")!;
    context.drawImage(renderer.domElement, 0, 0);
    this.marks.drawNames(context, renderer.getPixelRatio());
    canvas.toBlob((image) => image && saveBlob(image, "scenegate.png"));
  };
}
