// Panel of the controls of programs, in their folders.

import type { Model } from "../model";
import { ControlInput } from "./controlinputs";
import { GizmoFields } from "./gizmofields";
import { PlotView } from "./plotview";
import { type Folder, foldersOf, type ProgramControl, type ProgramControls } from "./programcontrols";

interface PanelProps {
  controls: ProgramControls;
  model: Model;
}

export function ControlsPanel({ controls, model }: PanelProps) {
  return (
    <section class="program-controls" aria-label="Controls of programs">
      <FolderContent folder={foldersOf(controls.all.value)} controls={controls} model={model} />
    </section>
  );
}

function FolderContent({ folder, controls, model }: PanelProps & { folder: Folder }) {
  return (
    <>
      {folder.controls.map((control) => (
        <Row key={control.definition.id} control={control} controls={controls} model={model} />
      ))}
      {[...folder.folders].map(([name, inner]) => (
        <details key={name} class="group" open>
          <summary>{name}</summary>
          <FolderContent folder={inner} controls={controls} model={model} />
        </details>
      ))}
    </>
  );
}

function Row({ control, controls, model }: PanelProps & { control: ProgramControl }) {
  if (control.definition.type === "plot") return <PlotView control={control} />;
  if (control.definition.type === "gizmo") return <GizmoFields control={control} controls={controls} model={model} />;
  return <ControlInput control={control} set={(value) => controls.set(control, value)} />;
}
