// Size of all points: as published, in pixels, or in metres.

import { useSignal } from "@preact/signals";
import type { Materials, PointSize } from "../view/materials";
import { Select } from "../widgets/controls";

const UNITS: [PointSize["unit"], string][] = [
  ["sent", "As published"],
  ["pixels", "Pixels"],
  ["metres", "Metres"],
];
const FIRST_SIZES = { sent: 2, pixels: 2, metres: 0.02 };

export function PointSizeFields({ materials }: { materials: Materials }) {
  const points = useSignal<PointSize>({ size: 2, unit: "sent" });
  const set = (size: PointSize) => materials.setPointSize((points.value = size));
  const { size, unit } = points.value;
  return (
    <div class="points">
      <Select label="Point size" value={unit} choices={UNITS} onChange={(chosen) => set({ unit: chosen, size: FIRST_SIZES[chosen] })} />
      <input
        type="number"
        aria-label="Size of points"
        min={0}
        step="any"
        disabled={unit === "sent"}
        value={size}
        onInput={({ currentTarget }) => set({ unit, size: Math.max(0, Number(currentTarget.value)) })}
      />
    </div>
  );
}
