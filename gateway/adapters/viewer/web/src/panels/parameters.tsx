// The stereo camera's REST parameters, by the inputs of controls.

import { signal, useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { ControlInput } from "../programs/controlinputs";
import type { ProgramControl } from "../programs/programcontrols";
import type { ControlDefinition, ControlValue } from "../protocol";

const BASE = "api/v2/pipelines/0/nodes";
const NODES = { rc_camera: "Camera", rc_stereomatching: "Stereo matching", rc_iocontrol: "Outputs" };
const TYPES: Record<Parameter["type"], ControlDefinition["type"]> = { float64: "slider", int32: "slider", bool: "checkbox", string: "dropdown" };
/** Time after which a value is sent, while a slider is dragged after its last movement, ms. */
const DELAY = 100;
const WITHOUT_EFFECT = " (kept, but without effect on this synthetic camera)";

interface Parameter {
  name: string;
  type: "float64" | "int32" | "bool" | "string";
  value: number | boolean | string;
  min: number;
  max: number;
  description: string;
}

/** The parameters of all nodes, read when they are shown. `size`: width and height of the camera's images. */
export function Parameters({ size }: { size: [number, number] | null }) {
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
            <Control key={parameter.name} url={`${BASE}/${node}/parameters/${parameter.name}`} parameter={parameter} size={size} />
          ))}
        </details>
      ))}
    </div>
  );
}

/** Return a parameter as a control, and what it does. The description of an enumeration ends with a list of its choices. */
function controlOf(
  { name, type, value, min, max, description }: Parameter,
  size: [number, number] | null,
): { control: ProgramControl; about: string } {
  const text = description.replace(WITHOUT_EFFECT, "");
  const list = type === "string" ? text.lastIndexOf(":") : text.length;
  const options = text.slice(list + 1).split(",");
  // The device takes regions beyond its image.
  const extent = size && (/_(offset_x|width)$/.test(name) ? size[0] : /_(offset_y|height)$/.test(name) ? size[1] : null);
  const shownMax = extent === null ? max : Math.max(Number(value), Math.min(max, extent));
  const isLogarithmic = min > 0 && max / min > 200;
  const step = type === "int32" ? 1 : undefined;
  const definition = { id: 0, path: [name], type: TYPES[type], value, min, max: shownMax, step, logarithmic: isLogarithmic };
  const control = { definition: { ...definition, options: options.map((choice) => choice.trim()) }, value: signal(value), samples: signal([]) };
  return { control, about: text.slice(0, list) };
}

function Control({ url, parameter, size }: { url: string; parameter: Parameter; size: [number, number] | null }) {
  const problem = useSignal("");
  const { control, about } = useMemo(() => controlOf(parameter, size), [parameter]);
  const timer = useRef(0);
  const set = (next: ControlValue) => {
    control.value.value = typeof next === "number" && parameter.type === "int32" ? Math.round(next) : next;
    clearTimeout(timer.current);
    timer.current = setTimeout(put, DELAY);
  };
  const put = async () => {
    const value = control.value.peek();
    try {
      const headers = { "Content-Type": "application/json" };
      const response = await fetch(url, { method: "PUT", headers, body: JSON.stringify({ value }) });
      const body = (await response.json()) as Parameter & { message?: string };
      problem.value = response.ok ? "" : (body.message ?? response.statusText);
      if (response.ok && control.value.peek() === value) control.value.value = body.value;
    } catch {
      problem.value = "The gateway does not respond.";
    }
  };
  const hasNoEffect = parameter.description.includes(WITHOUT_EFFECT);
  return (
    <div class={`parameter${hasNoEffect ? " idle" : ""}`}>
      <ControlInput control={control} set={set} />
      <div class="about">{about + (hasNoEffect ? "; kept, but without effect here" : "")}</div>
      <div class="problem" role="alert" hidden={!problem.value}>
        {problem}
      </div>
    </div>
  );
}
