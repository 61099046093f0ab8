// A gizmo in the panel: what its handles in the view do, and the pose of its node in numbers.

import { pathText } from "../format";
import type { Model } from "../model";
import { Select } from "../widgets/controls";
import { DraftInput, rounded } from "./controlinputs";
import { numbersOf, poseOf, poseOfNumbers } from "./gizmopose";
import { GIZMO_MODES, gizmoMode } from "./gizmos";
import type { ProgramControl, ProgramControls } from "./programcontrols";

const FIELDS = ["x", "y", "z", "roll", "pitch", "yaw"] as const;

interface GizmoProps {
  control: ProgramControl;
  controls: ProgramControls;
  model: Model;
}

export function GizmoFields({ control, controls, model }: GizmoProps) {
  const { path, node: nodePath = [] } = control.definition;
  controls.updates.value; // the pose is that of the node
  const name = String(path.at(-1));
  const node = model.find(nodePath);
  if (!node)
    return (
      <div class="program-control gizmo">
        <span>{name}</span>
        <span class="empty">{pathText(nodePath)} is not in the scene.</span>
      </div>
    );
  const values = numbersOf(poseOf(node.local));
  const mode = gizmoMode(control.definition.id);
  const commit = (field: number, text: string) => {
    const number = Number.parseFloat(text);
    if (Number.isFinite(number)) controls.set(control, poseOfNumbers(values.map((value, i) => (i === field ? number : value))));
  };
  return (
    <div class="program-control gizmo" role="group" aria-label={name}>
      <span>{name}</span>
      <Select label={`${name}, handles`} value={mode.value} choices={GIZMO_MODES} onChange={(next) => (mode.value = next)} />
      {FIELDS.map((field, i) => (
        <label key={field}>
          {field} <span class="unit">{i < 3 ? "m" : "°"}</span>
          <DraftInput type="number" step={i < 3 ? 0.01 : 1} shown={rounded(values[i] ?? 0)} commit={(text) => commit(i, text)} />
        </label>
      ))}
    </div>
  );
}
