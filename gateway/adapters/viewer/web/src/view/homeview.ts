// The home view: all of the scene, or the camera that a client has set. It follows the first nodes and the shape of the window.

import type { Box3 } from "three";
import type { PageSettings } from "../protocol";
import type { CameraRig } from "./camerarig";

/** Time in which the home view follows the nodes that are added. */
const FRAMING_MS = 2000;

export class HomeView {
  /** Time until which the home view follows the first nodes, `performance.now()`; publishers send one after the other. */
  private framingEnds = Infinity;
  /** `rig.placements` after the home view was last shown. */
  private framed: number;
  private camera?: PageSettings["home"];

  /** @param focusBoxes returns the bounds that the home view frames */
  constructor(
    private readonly rig: CameraRig,
    private readonly focusBoxes: () => Box3[],
  ) {
    this.framed = rig.placements;
  }

  /** True until the camera is moved. */
  get isShown(): boolean {
    return this.rig.placements === this.framed;
  }

  show(): void {
    if (this.camera) this.rig.place(this.camera);
    else this.rig.look("home", this.focusBoxes());
    this.framed = this.rig.placements;
  }

  /** Leave the camera where a link has placed it. */
  leave(): void {
    this.framingEnds = 0;
  }

  /** Frame the scene while its first nodes arrive, unless the camera was moved meanwhile. Called with each update. */
  followNodes(areAdded: boolean): void {
    const now = performance.now();
    const isFirst = this.framingEnds === Infinity;
    if (isFirst) this.framingEnds = now + FRAMING_MS;
    if (isFirst || (areAdded && now <= this.framingEnds && this.isShown)) this.show();
  }

  /** Set the camera of a client; return true if it has to be shown. The first one does not replace that of a link. */
  setCamera(camera: PageSettings["home"]): boolean {
    const isFirst = this.camera === undefined;
    const isNew = JSON.stringify(camera) !== JSON.stringify(this.camera);
    this.camera = camera;
    return camera !== null && isNew && !(isFirst && this.framingEnds === 0);
  }
}
