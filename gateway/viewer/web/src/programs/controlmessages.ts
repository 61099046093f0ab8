// Messages about the controls of programs: client/scenegate/messages/controls.py, gateway/viewer/control_frames.py.

import type { Path, Vector } from "../protocol";

export interface Pose {
  translation: Vector;
  /** [w, x, y, z] */
  quaternion: [number, number, number, number];
}

export type ControlType = "button" | "slider" | "number" | "text" | "checkbox" | "dropdown" | "color" | "plot" | "gizmo";
export type ControlValue = number | string | boolean | Vector | Pose | null;

/** A control of a program: client/scenegate/messages/controls.py. */
export interface ControlDefinition {
  id: number;
  type: ControlType;
  path: Path;
  value: ControlValue;
  min?: number;
  max?: number;
  step?: number;
  unit?: string;
  /** True: the slider has equal steps for equal factors. Of the page's own controls. */
  logarithmic?: boolean;
  options?: string[];
  /** Names of the curves of a plot. */
  series?: string[];
  /** Length of a plot's time axis. */
  seconds?: number;
  /** Path of a gizmo's node. */
  node?: Path;
}

export interface ControlsMessage {
  kind: "controls";
  /** All controls; null: as before. */
  controls: ControlDefinition[] | null;
  /** New values by the ids of their controls. */
  values: [number, ControlValue][];
  /** New samples by the ids of their plots: rows of time and values. */
  samples: [number, Float64Array][];
}

/** The gateway has executed a change of this page: values that follow are not older. */
export interface Received {
  kind: "received";
  number: number;
}

/** Message to the gateway about a change of a control. */
export interface ControlChange {
  control: number;
  /** Number of the change, ascending. */
  number: number;
  value: ControlValue;
}
