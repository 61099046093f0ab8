// Controls for the stereo camera's REST parameters.

import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { Select, Slider } from "./controls";
import { short } from "./format";

const BASE = "api/v2/pipelines/0/nodes";
const NODES = { rc_camera: "Camera", rc_stereomatching: "Stereo matching", rc_iocontrol: "Outputs" };
const WITHOUT_EFFECT = " (kept, but without effect on this synthetic camera)";

type Value = number | boolean | string;

interface Parameter {
  name: string;
  type: "float64" | "int32" | "bool" | "string";
  value: Value;
  min: number;
  max: number;
  default: Value;
  description: string;
}

/** The parameters of all nodes, read when they are shown. */
export function Parameters() {
  const groups = useSignal<{ node: string; title: string; parameters: Parameter[] }[]>([]);
  const load = async () => {
    const read = async ([node, title]: [string, string]) => {
      const response = await fetch(`${BASE}/${node}/parameters`).catch(() => null);
      return { node, title, parameters: response?.ok ? ((await response.json()) as Parameter[]) : [] };
    };
    const all = await Promise.all(Object.entries(NODES).map(read));
    groups.value = all.filter(({ parameters }) => parameters.length);
  };
  useEffect(() => void load(), []);
  return (
    <div class="parameters">
      {groups.value.map(({ node, title, parameters }) => (
        <details key={node} class="group">
          <summary>{title}</summary>
          {parameters.map((parameter) => (
            <Control key={parameter.name} node={node} parameter={parameter} />
          ))}
        </details>
      ))}
    </div>
  );
}

function Control({ node, parameter }: { node: string; parameter: Parameter }) {
  const problem = useSignal("");
  const value = useSignal(parameter.value);
  const set = async (next: Value) => {
    value.value = next;
    try {
      const response = await fetch(`${BASE}/${node}/parameters/${parameter.name}`, {
        method: "PUT",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ value: next }),
      });
      const body = (await response.json()) as Parameter & { message?: string };
      problem.value = response.ok ? "" : (body.message ?? response.statusText);
      if (response.ok) value.value = body.value;
    } catch {
      problem.value = "The gateway does not respond.";
    }
  };
  const hasNoEffect = parameter.description.includes(WITHOUT_EFFECT);
  const text = parameter.description.replace(WITHOUT_EFFECT, "");
  // An enumeration is a list of its choices.
  const list = parameter.type === "string" ? text.lastIndexOf(":") : text.length;
  const choices = text
    .slice(list + 1)
    .split(",")
    .map((choice) => choice.trim());
  return (
    <div class={`parameter${hasNoEffect ? " idle" : ""}`}>
      <code>{parameter.name}</code>
      <div class="about">{text.slice(0, list) + (hasNoEffect ? "; kept, but without effect here" : "")}</div>
      <Input parameter={parameter} value={value.value} choices={choices} set={set} />
      <div class="problem" role="alert" hidden={!problem.value}>
        {problem}
      </div>
    </div>
  );
}

interface InputProps {
  parameter: Parameter;
  value: Value;
  /** Of an enumeration. */
  choices: string[];
  set: (value: Value) => void;
}

function Input({ parameter: { name, type, min, max }, value, choices, set }: InputProps) {
  const dragged = useSignal<number | null>(null);
  if (type === "bool")
    return <input type="checkbox" checked={value === true} aria-label={name} onChange={({ currentTarget }) => set(currentTarget.checked)} />;
  if (type === "string") return <Select label={name} value={String(value)} choices={choices.map((choice) => [choice, choice])} onChange={set} />;
  // Ranges over several powers of ten get a logarithmic slider.
  const isLogarithmic = min > 0 && max / min > 200;
  const rounded = (number: number) => (type === "int32" ? Math.round(number) : number);
  const position = (number: number) => (isLogarithmic ? Math.log(number / min) / Math.log(max / min) : (number - min) / (max - min));
  const at = (place: number) => rounded(isLogarithmic ? min * (max / min) ** place : min + place * (max - min));
  const shown = dragged.value ?? Number(value);
  const drop = (place: number) => {
    dragged.value = null;
    set(at(place));
  };
  return (
    <div class="row-of-two">
      <Slider label={`${name} slider`} step={0.001} value={position(shown)} onInput={(place) => (dragged.value = at(place))} onChange={drop} />
      <input
        type="number"
        min={min}
        max={max}
        step={type === "int32" ? 1 : "any"}
        value={short(shown)}
        aria-label={name}
        onChange={({ currentTarget }) => set(rounded(Number(currentTarget.value)))}
      />
    </div>
  );
}
