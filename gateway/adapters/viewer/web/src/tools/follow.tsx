// The node that the camera follows: the motion that carries the camera along, and a bar over the view.

import { signal } from "@preact/signals";
import { Matrix4, Quaternion, Vector3 } from "three";
import { pathText } from "../format";
import type { Model, TreeNode } from "../model";
import type { Path, Vector } from "../protocol";
import type { CameraView } from "../view/camera";
import type { CameraRig } from "../view/camerarig";
import { Button, Pill, Select } from "../widgets/controls";

/** `follow`: the camera is moved with the node and keeps its heading; `ride`: it is turned with the node, too. */
export type FollowMode = "follow" | "ride";
export interface Followed {
  path: Path;
  mode: FollowMode;
}
const MODES: [FollowMode, string][] = [
  ["follow", "keeps its heading"],
  ["ride", "rides along"],
];

/** Return position and rotation of a node in the world; null if they are not finite. */
function poseOf({ world }: TreeNode): Matrix4 | null {
  const [position, rotation] = [new Vector3(), new Quaternion()];
  world.decompose(position, rotation, new Vector3());
  const pose = new Matrix4().compose(position, rotation.normalize(), new Vector3(1, 1, 1));
  return pose.elements.every(Number.isFinite) ? pose : null;
}

/** Return the frame in which the camera rests, of a node with a pose. */
function frameOf(pose: Matrix4, mode: FollowMode): Matrix4 {
  return mode === "ride" ? pose : new Matrix4().copyPosition(pose);
}

export class Follow {
  /** Null: the camera rests in the world. */
  readonly followed = signal<Followed | null>(null);
  /** False while the scene does not have the node. */
  readonly isThere = signal(false);
  private node: TreeNode | null = null;
  /** Pose of the node for which the camera was placed. */
  private pose = new Matrix4();

  /** @param changed called when another node is followed, none, or in another way */
  constructor(
    private readonly model: Model,
    private readonly changed: () => void = () => undefined,
  ) {}

  /**
   * Follow a node from now on.
   *
   * @param isRelative true: the camera was placed relative to the node, as that of a link, and not in the world
   */
  start(followed: Followed, isRelative = false): void {
    this.followed.value = followed;
    this.find(followed.path);
    this.pose = (!isRelative && this.node && poseOf(this.node)) || new Matrix4();
    this.changed();
  }

  /** Return how a node is followed; null: it is not. */
  modeOf(node: TreeNode | null): FollowMode | null {
    const { value } = this.followed;
    return node && value && JSON.stringify(node.path) === JSON.stringify(value.path) ? value.mode : null;
  }

  setMode = (mode: FollowMode): void => {
    const { value } = this.followed;
    if (value) this.followed.value = { ...value, mode };
    this.changed();
  };

  stop = (): void => {
    if (!this.followed.peek()) return;
    this.followed.value = null;
    this.changed();
  };

  /** Follow a node, then ride along with it, then stop; without a node, stop. */
  cycle(node: TreeNode | null): void {
    const mode = this.modeOf(node);
    if (node && mode !== "ride") this.start({ path: node.path, mode: mode ? "ride" : "follow" });
    else this.stop();
  }

  /** Carry a camera along as the node has moved; while a gizmo's handle is dragged, afterwards. */
  carry(rig: CameraRig): void {
    const motion = rig.controls.enabled ? this.motion() : null;
    if (motion) rig.move(moved(rig.view, motion));
  }

  /** Return the motion of the node since the last call, for the camera; null if there is none. */
  motion(): Matrix4 | null {
    const { value: followed } = this.followed;
    if (!followed) return null;
    if (!this.node || this.model.nodes.get(this.node.id) !== this.node) this.find(followed.path);
    const pose = this.node && poseOf(this.node);
    if (!pose || pose.equals(this.pose)) return null;
    const before = frameOf(this.pose, followed.mode);
    this.pose = pose;
    return before.invert().premultiply(frameOf(pose, followed.mode));
  }

  /** Return a camera of the world relative to the node, if one is followed. */
  relative(view: CameraView): CameraView {
    const { value: followed } = this.followed;
    return followed ? moved(view, frameOf(this.pose, followed.mode).clone().invert()) : view;
  }

  private find(path: Path): void {
    this.node = this.model.find(path);
    this.isThere.value = this.node !== null;
  }
}

/** Return a camera after a rigid motion. */
export function moved(view: CameraView, motion: Matrix4): CameraView {
  const at = (point: Vector) => new Vector3(...point).applyMatrix4(motion).toArray();
  const up = new Vector3(...view.up).transformDirection(motion).toArray();
  return { ...view, eye: at(view.eye), target: at(view.target), up };
}

export function FollowBar({ follow: { followed, isThere, setMode, stop } }: { follow: Follow }) {
  if (!followed.value) return null;
  const { path, mode } = followed.value;
  const name = pathText(path);
  return (
    <Pill label="The camera follows a node" icon="follow">
      <span class="name" title={name}>
        {name}
      </span>
      {!isThere.value && <span class="quiet">is not in the scene</span>}
      <Select label="The camera" value={mode} choices={MODES} onChange={setMode} />
      <Button icon="close" title="Stop following (C)" onClick={stop} />
    </Pill>
  );
}
