// The axes of the world as the camera sees them. A click looks along an axis.

import type { Signal } from "@preact/signals";
import { Quaternion, Vector3 } from "three";
import { DIRECTIONS, type Direction } from "../view/camera";
import type { CameraRig } from "../view/camerarig";

/** Distance of the ends from the middle, CSS pixels. */
const RADIUS = 32;

interface End {
  direction: Direction;
  axis: "x" | "y" | "z";
  sign: 1 | -1;
  label: string;
}
const ENDS: End[] = [
  { direction: "front", axis: "x", sign: 1, label: "Front, from +X" },
  { direction: "back", axis: "x", sign: -1, label: "Back, from −X" },
  { direction: "left", axis: "y", sign: 1, label: "Left side, from +Y" },
  { direction: "side", axis: "y", sign: -1, label: "Right side, from −Y" },
  { direction: "top", axis: "z", sign: 1, label: "Top, from +Z" },
  { direction: "bottom", axis: "z", sign: -1, label: "Bottom, from −Z" },
];

/** Look at the target from a direction, at the same distance. */
function turnTo(rig: CameraRig, direction: Direction): void {
  const { target, halfHeight, orthographic } = rig.view;
  const eye = new Vector3(...DIRECTIONS[direction]).setLength(rig.controls.getDistance()).add(new Vector3(...target));
  rig.place({ eye: eye.toArray(), target, up: [0, 0, 1], ...(orthographic && { halfHeight }) });
}

export function ViewAxes({ rig, rotation }: { rig: CameraRig; rotation: Signal<[number, number, number, number]> }) {
  const toCamera = new Quaternion(...rotation.value).invert();
  const ends = ENDS.map((end) => ({ ...end, at: new Vector3().setComponent("xyz".indexOf(end.axis), end.sign).applyQuaternion(toCamera) }));
  return (
    <div class="view-axes" role="group" aria-label="Look along an axis">
      <svg viewBox="-48 -48 96 96" aria-hidden="true">
        {ends.map(({ axis, sign, at }) => sign > 0 && <line key={axis} class={axis} x2={RADIUS * at.x} y2={-RADIUS * at.y} />)}
      </svg>
      {ends.map(({ direction, axis, sign, label, at }) => (
        <button
          key={direction}
          type="button"
          class={sign > 0 ? axis : `${axis} negative`}
          aria-label={label}
          title={label}
          style={`translate: ${RADIUS * at.x}px ${-RADIUS * at.y}px; z-index: ${Math.round(10 + 9 * at.z)}`}
          onClick={() => turnTo(rig, direction)}
        >
          {sign > 0 && axis.toUpperCase()}
        </button>
      ))}
    </div>
  );
}
