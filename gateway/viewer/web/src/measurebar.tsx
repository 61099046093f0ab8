// Over the view, while clicks measure: what was measured.

import { Button } from "./controls";
import { Icon } from "./icons";
import { measured } from "./measure";
import type { Viewer } from "./viewer";

export function MeasureBar({ viewer }: { viewer: Viewer }) {
  const points = viewer.measurement.points.value;
  if (!points) return null;
  const { distance, details } = measured(points);
  return (
    <div class="pill" role="group" aria-label="Measurement">
      <Icon name="measure" />
      <span role="status">
        <strong>{distance}</strong> {details}
      </span>
      <Button icon="close" title="Stop measuring (M)" onClick={viewer.measurement.toggle} />
    </div>
  );
}
