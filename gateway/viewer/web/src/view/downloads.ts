// What can be downloaded of the view: the image as it is shown, the gateway's image, and the scene as a file.

import type { Color } from "three";
import type { Model } from "../model";
import type { Marks } from "../tools/marks";
import type { Timeline } from "../tools/timeline";
import { cameraText } from "./camera";
import type { Stage } from "./stage";

export class Downloads {
  constructor(
    private readonly stage: Stage,
    private readonly model: Model,
    private readonly marks: Marks,
    private readonly timeline: Timeline,
    private readonly holder: HTMLElement,
  ) {}

  /** Return this view as parameters of `/scene.glb`. */
  private viewQuery(): URLSearchParams {
    const { clientWidth: width, clientHeight: height } = this.holder;
    const { view, perspective } = this.stage.rig;
    const changed = [...this.model.nodes.values()].filter((node) => node.isShown !== node.visible);
    const paths = (on: boolean) => JSON.stringify(changed.filter((node) => node.isShown === on).map((node) => node.path));
    const camera = cameraText(view, perspective.fov, perspective.aspect);
    const { value: moment } = this.timeline.moment;
    const time: Record<string, string> = moment === null ? {} : { time: `${moment}` };
    return new URLSearchParams({ camera, width: `${width}`, height: `${height}`, hide: paths(false), show: paths(true), ...time });
  }

  /** Return the parameters of the gateway's image of this view. */
  imageQuery(): URLSearchParams {
    const query = this.viewQuery();
    query.set("background", (this.stage.scene.background as Color).getHexString());
    return query;
  }

  file = (): string => `scene.glb?${this.viewQuery()}`;

  rendering = (): string => `scene/render?${this.imageQuery()}`;

  /** Download the view as it is shown; without WebGL, an image of the gateway. */
  snapshot = (): void => {
    const save = (href: string) => Object.assign(document.createElement("a"), { href, download: "scenegate.png" }).click();
    const { renderer } = this.stage;
    if (!renderer) {
      save(this.rendering());
      return;
    }
    const { width, height } = renderer.domElement;
    const canvas = Object.assign(document.createElement("canvas"), { width, height });
    const context = canvas.getContext("2d")!;
    context.drawImage(renderer.domElement, 0, 0);
    this.marks.drawNames(context, renderer.getPixelRatio());
    canvas.toBlob((image) => {
      if (!image) return;
      const url = URL.createObjectURL(image);
      save(url);
      setTimeout(() => URL.revokeObjectURL(url), 10_000);
    });
  };
}
