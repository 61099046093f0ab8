// Direction and strength of the light on this page: in the view, and in the gateway's images of the view.

import { effect, signal } from "@preact/signals";
import { type Angles, type LightChange, NO_CHANGE } from "../view/lights";
import { Button } from "../widgets/controls";

/** Largest factor of a slider; the gateway takes larger ones, too. */
const MAX_FACTOR = 3;

export class ViewLight {
  readonly change = signal(NO_CHANGE);
  /** Direction of the gateway's key light; null: it has none. */
  readonly own = signal<Angles | null>(null);

  /**
   * @param apply draws the view with changed light
   * @param chosen called when the visitor has changed it
   */
  constructor(
    apply: (change: LightChange) => void,
    private readonly chosen: () => void,
  ) {
    effect(() => apply(this.change.value));
  }

  /** Adopt the visitor's choice. */
  choose(change: LightChange): void {
    this.change.value = change;
    this.chosen();
  }

  /** Parameters of the gateway's images; none for its own light. */
  get query(): Record<string, string> {
    const changed = Object.entries(this.change.peek()).filter(([name, value]) => value !== NO_CHANGE[name as keyof LightChange]);
    return Object.fromEntries(changed.map(([name, value]) => [`light_${name}`, String(value)]));
  }
}

type SliderProps = { text: string; title: string; min: number; max: number; step: number; unit: string; value: number; set: (value: number) => void };

function Slider({ text, title, unit, value, set, ...limits }: SliderProps) {
  return (
    <label class="field" title={title}>
      {text}
      <input type="range" {...limits} value={value} onInput={({ currentTarget }) => set(Number(currentTarget.value))} />
      <output>{`${Number(value.toFixed(unit ? 0 : 2))}${unit}`}</output>
    </label>
  );
}

export function LightFields({ light }: { light: ViewLight }) {
  const { change, own } = light;
  const { azimuth, elevation, strength, ambient } = change.value;
  const set = (part: Partial<LightChange>) => light.choose({ ...change.peek(), ...part });
  const factor = { min: 0, max: MAX_FACTOR, step: 0.05, unit: "" };
  const angle = { step: 1, unit: "°" };
  return (
    <>
      {own.value && (
        <>
          <Slider
            text="Key from"
            title="Direction of the key light, from +X, counter-clockwise from above"
            {...angle}
            min={-180}
            max={180}
            value={azimuth ?? own.value.azimuth}
            set={(degrees) => set({ azimuth: degrees })}
          />
          <Slider
            text="Key height"
            title="Degrees above the horizon"
            {...angle}
            min={0}
            max={90}
            value={elevation ?? own.value.elevation}
            set={(degrees) => set({ elevation: degrees })}
          />
          <Slider text="Key strength" title="1: as the gateway's" {...factor} value={strength} set={(times) => set({ strength: times })} />
        </>
      )}
      <Slider
        text="Ambient"
        title="Light of the environment; 1: as the gateway's"
        {...factor}
        value={ambient}
        set={(times) => set({ ambient: times })}
      />
      {change.value !== NO_CHANGE && (
        <Button icon="close" class="plain" title="The light of the gateway's images" onClick={() => light.choose(NO_CHANGE)}>
          Reset the light
        </Button>
      )}
    </>
  );
}
