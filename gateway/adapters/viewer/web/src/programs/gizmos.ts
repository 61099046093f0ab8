// Handles in the view by which programs let people move nodes.

import { effect, type Signal, signal } from "@preact/signals";
import { Matrix4, Object3D, Vector3 } from "three";
import { TransformControls } from "three/addons/controls/TransformControls.js";
import type { Model, TreeNode } from "../model";
import { options } from "../options";
import type { Stage } from "../view/stage";
import { poseOf } from "./gizmopose";
import type { ProgramControl, ProgramControls } from "./programcontrols";

export type GizmoMode = "translate" | "rotate" | "off";
export const GIZMO_MODES: [GizmoMode, string][] = [
  ["translate", "Move"],
  ["rotate", "Turn"],
  ["off", "Hide handles"],
];
const modes = new Map<number, Signal<GizmoMode>>();

/** Return what the handles of a gizmo do, by the id of its control. */
export function gizmoMode(id: number): Signal<GizmoMode> {
  const mode = modes.get(id) ?? signal<GizmoMode>("translate");
  modes.set(id, mode);
  return mode;
}

export class Gizmos {
  /** By the ids of their controls. */
  private readonly gizmos = new Map<number, Gizmo>();

  constructor(
    stage: Stage,
    model: Model,
    private readonly controls: ProgramControls,
  ) {
    effect(() => {
      const wanted = new Map(controls.all.value.map((control) => [control.definition.id, control]));
      for (const [id, gizmo] of this.gizmos) {
        if (wanted.has(id)) continue;
        gizmo.dispose();
        this.gizmos.delete(id);
      }
      for (const [id, control] of wanted) {
        if (control.definition.type !== "gizmo" || !stage.renderer) continue;
        const gizmo = this.gizmos.get(id);
        if (gizmo) gizmo.control = control;
        else this.gizmos.set(id, new Gizmo(stage, model, controls, control));
      }
      this.follow();
    });
    effect(() => {
      options.orthographic.shown.value;
      for (const gizmo of this.gizmos.values()) gizmo.handles.camera = stage.rig.camera;
    });
  }

  /** Place the handles at their nodes. */
  follow(): void {
    for (const gizmo of this.gizmos.values()) gizmo.follow();
    this.controls.updates.value = this.controls.updates.peek() + 1;
  }
}

class Gizmo {
  readonly handles: TransformControls;
  /** Moved by the handles; it has the node's pose in the world. */
  private readonly target = new Object3D();
  private readonly stopFollowing: () => void;

  constructor(
    private readonly stage: Stage,
    private readonly model: Model,
    private readonly controls: ProgramControls,
    public control: ProgramControl,
  ) {
    this.handles = new TransformControls(stage.rig.camera, stage.canvas);
    this.handles.setSpace("local");
    stage.world.add(this.target);
    stage.scene.add(this.handles.getHelper());
    this.handles.addEventListener("change", () => stage.redraw());
    this.handles.addEventListener("dragging-changed", ({ value }) => {
      stage.rig.controls.enabled = !value;
      this.follow();
    });
    this.handles.addEventListener("objectChange", () => this.report());
    this.stopFollowing = effect(() => {
      const { value: mode } = gizmoMode(control.definition.id);
      if (mode !== "off") this.handles.setMode(mode);
      this.follow();
    });
  }

  private get node(): TreeNode | null {
    return this.model.find(this.control.definition.node ?? []);
  }

  follow(): void {
    if (this.handles.dragging) return;
    const { node } = this;
    const isShown = node !== null && gizmoMode(this.control.definition.id).peek() !== "off";
    if (isShown && !this.handles.object) this.handles.attach(this.target);
    if (!isShown) this.handles.detach();
    node?.world.decompose(this.target.position, this.target.quaternion, new Vector3());
    this.stage.redraw();
  }

  /** Send the pose relative to the node above. */
  private report(): void {
    const above = this.node?.parent;
    if (!above) return;
    const pose = new Matrix4().compose(this.target.position, this.target.quaternion, new Vector3(1, 1, 1));
    pose.premultiply(above.world.clone().invert());
    this.controls.set(this.control, poseOf(pose));
  }

  dispose(): void {
    this.stopFollowing();
    this.stage.rig.controls.enabled = true;
    this.handles.detach();
    this.handles.dispose();
    this.handles.getHelper().removeFromParent();
    this.target.removeFromParent();
  }
}
