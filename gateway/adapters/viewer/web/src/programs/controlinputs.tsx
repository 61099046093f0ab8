// Inputs of controls: buttons, sliders, numbers, texts, check boxes, menus, colours.

import { useSignal } from "@preact/signals";
import type { InputHTMLAttributes, TargetedEvent } from "preact";
import { useId } from "preact/hooks";
import { short } from "../format";
import type { ControlValue } from "../protocol";
import { Check, Select } from "../widgets/controls";
import type { ProgramControl } from "./programcontrols";

interface InputProps {
  control: ProgramControl;
  /** Takes a new value; null: the button was clicked. */
  set: (value: ControlValue) => void;
}

export function ControlInput({ control, set }: InputProps) {
  const { definition, value } = control;
  const name = String(definition.path.at(-1));
  const id = useId();
  if (definition.type === "button")
    return (
      <button type="button" class="program-button" onClick={() => set(null)}>
        {name}
      </button>
    );
  if (definition.type === "slider") return <SliderRow control={control} set={set} />;
  if (definition.type === "checkbox") return <Check class="program-control check" text={name} checked={value.value === true} onChange={set} />;
  return (
    <div class="program-control">
      <label for={id}>{name}</label>
      {definition.type === "number" && <NumberField id={id} control={control} set={set} />}
      {definition.type === "text" && <DraftInput id={id} type="text" maxLength={1000} shown={String(value.value)} commit={set} />}
      {definition.type === "dropdown" && (
        <Select id={id} value={String(value.value)} choices={(definition.options ?? []).map((text) => [text, text])} onChange={set} />
      )}
      {definition.type === "color" && (
        <input id={id} type="color" value={hex(value.value)} onInput={({ currentTarget }) => set(channels(currentTarget.value))} />
      )}
    </div>
  );
}

function SliderRow({ control, set }: InputProps) {
  const { min = 0, max = 1, step, path, logarithmic } = control.definition;
  const id = useId();
  const place = (value: number) => (logarithmic ? Math.log(value / min) : value);
  const at = (place: number) => (logarithmic ? min * Math.exp(place) : place);
  return (
    <div class="program-control slider">
      <label for={id}>{String(path.at(-1))}</label>
      <NumberField label={`${path.at(-1)}, value`} control={control} set={set} />
      <span class="range">
        {short(min)}
        <input
          id={id}
          type="range"
          min={place(min)}
          max={place(max)}
          step={logarithmic ? 0.001 : (step ?? "any")}
          value={place(Number(control.value.value))}
          aria-valuetext={short(Number(control.value.value))}
          onInput={({ currentTarget }) => set(at(Number(currentTarget.value)))}
        />
        {short(max)}
      </span>
    </div>
  );
}

/** Number with unit. A number beyond the limits becomes the limit. */
function NumberField({ control, set, id, label }: InputProps & { id?: string; label?: string }) {
  const { min = -Infinity, max = Infinity, step, unit, type } = control.definition;
  const limited = useSignal("");
  const commit = (text: string) => {
    const number = Number.parseFloat(text);
    if (!Number.isFinite(number)) return;
    limited.value = number < min ? `at least ${short(min)}` : number > max ? `at most ${short(max)}` : "";
    set(Math.min(Math.max(number, min), max));
  };
  const degrees = unit === "rad" && `${((180 / Math.PI) * Number(control.value.value)).toFixed(1)}°`;
  const limits = { min: Number.isFinite(min) ? min : undefined, max: Number.isFinite(max) ? max : undefined };
  const keyStep = step ?? (type === "slider" ? "any" : undefined);
  return (
    <span class="number-field">
      <DraftInput id={id} aria-label={label} type="number" {...limits} step={keyStep} shown={rounded(Number(control.value.value))} commit={commit} />
      {unit && (
        <span class="unit" title={unit}>
          {unit}
        </span>
      )}
      {degrees && <span class="unit">{degrees}</span>}
      {limited.value && (
        <span class="warn" role="status">
          {limited}
        </span>
      )}
    </span>
  );
}

/** Format a number with six significant digits. */
export const rounded = (value: number): string => String(Number(value.toPrecision(6)));

type DraftProps = InputHTMLAttributes & {
  /** Text of the current value. */
  shown: string;
  /** Take a text, unless it is invalid. */
  commit: (text: string) => void;
};

/** Input whose text is taken when it is complete. New values do not replace a text that is being edited. */
export function DraftInput({ shown, commit, ...more }: DraftProps) {
  const draft = useSignal<string | null>(null);
  const end = ({ currentTarget }: TargetedEvent<HTMLInputElement>) => {
    if (draft.value !== null) commit(currentTarget.value);
    draft.value = null;
  };
  const cancel = (event: KeyboardEvent) => {
    if (event.key !== "Escape" || draft.value === null) return;
    draft.value = null;
    event.preventDefault();
  };
  return (
    <input
      {...more}
      value={draft.value ?? shown}
      onInput={({ currentTarget }) => (draft.value = currentTarget.value)}
      onChange={end}
      onBlur={end}
      onKeyDown={cancel}
    />
  );
}

function hex(value: unknown): string {
  const byte = (channel: number) =>
    Math.round(255 * channel)
      .toString(16)
      .padStart(2, "0");
  return `#${(value as number[]).map(byte).join("")}`;
}

function channels(color: string): [number, number, number] {
  const channel = (at: number) => Number.parseInt(color.slice(at, at + 2), 16) / 255;
  return [channel(1), channel(3), channel(5)];
}
