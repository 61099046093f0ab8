// Controls for the stereo camera's REST parameters.

import { h, short } from "./dom";

const BASE = "api/v2/pipelines/0/nodes";
const NODES = { rc_camera: "Camera", rc_stereomatching: "Stereo matching", rc_iocontrol: "Outputs" };
const WITHOUT_EFFECT = " (kept, but without effect on this synthetic camera)";

interface Parameter {
  name: string;
  type: "float64" | "int32" | "bool" | "string";
  value: number | boolean | string;
  min: number;
  max: number;
  default: number | boolean | string;
  description: string;
}

export class Parameters {
  readonly element = h("div", { class: "parameters" });

  /** Read all values again. */
  async load(): Promise<void> {
    const groups = await Promise.all(Object.entries(NODES).map(([node, title]) => this.group(node, title)));
    const open = new Set([...this.element.querySelectorAll<HTMLDetailsElement>("details[open]")].map((e) => e.dataset.node));
    for (const group of groups) if (group && open.has(group.dataset.node)) group.open = true;
    this.element.replaceChildren(...groups.filter((group) => group !== null));
  }

  private async group(node: string, title: string): Promise<HTMLDetailsElement | null> {
    const response = await fetch(`${BASE}/${node}/parameters`).catch(() => null);
    if (!response?.ok) return null;
    const parameters = (await response.json()) as Parameter[];
    const group = h("details", { class: "group" }, h("summary", {}, title), ...parameters.map((p) => control(node, p)));
    group.dataset.node = node;
    return group;
  }
}

function control(node: string, parameter: Parameter): HTMLElement {
  const problem = h("div", { class: "problem", role: "alert", hidden: true });
  const show = (text: string) => {
    problem.textContent = text;
    problem.hidden = text === "";
  };
  const set = async (value: Parameter["value"]): Promise<Parameter["value"]> => {
    try {
      const response = await fetch(`${BASE}/${node}/parameters/${parameter.name}`, {
        method: "PUT",
        headers: { "Content-Type": "application/json" },
        body: JSON.stringify({ value }),
      });
      const body = (await response.json()) as Parameter & { message?: string };
      show(response.ok ? "" : (body.message ?? response.statusText));
      return response.ok ? body.value : value;
    } catch {
      show("The gateway does not respond.");
      return value;
    }
  };
  const hasNoEffect = parameter.description.includes(WITHOUT_EFFECT);
  const text = parameter.description.replace(WITHOUT_EFFECT, "");
  // An enumeration is a list of its choices.
  const description = parameter.type === "string" ? text.slice(0, text.lastIndexOf(":")) : text;
  return h(
    "div",
    { class: `parameter${hasNoEffect ? " idle" : ""}` },
    h("code", {}, parameter.name),
    h("div", { class: "about" }, hasNoEffect ? `${description}; kept, but without effect here` : description),
    input(parameter, text, set),
    problem,
  );
}

type Set = (value: Parameter["value"]) => Promise<Parameter["value"]>;

function input(parameter: Parameter, text: string, set: Set): HTMLElement {
  if (parameter.type === "bool") {
    const box = h("input", { type: "checkbox", checked: parameter.value === true, "aria-label": parameter.name });
    box.addEventListener("change", async () => (box.checked = (await set(box.checked)) === true));
    return box;
  }
  if (parameter.type === "string") {
    const choices = text.slice(text.lastIndexOf(":") + 1).split(",").map((choice) => choice.trim());
    const select = h("select", { "aria-label": parameter.name }, ...choices.map((choice) => h("option", {}, choice)));
    select.value = String(parameter.value);
    select.addEventListener("change", async () => (select.value = String(await set(select.value))));
    return select;
  }
  const { min, max } = parameter;
  const step = parameter.type === "int32" ? 1 : "any";
  const number = h("input", { type: "number", min, max, step, value: short(Number(parameter.value)), "aria-label": parameter.name });
  // Ranges over several isLogarithmic get a logarithmic slider.
  const isLogarithmic = min > 0 && max / min > 200;
  const sliderPosition = (value: number) => (isLogarithmic ? Math.log(value / min) / Math.log(max / min) : (value - min) / (max - min));
  const range = h("input", { type: "range", min: 0, max: 1, step: 0.001, value: sliderPosition(Number(parameter.value)), "aria-label": `${parameter.name} slider` });
  const change = async (value: number) => {
    const accepted = Number(await set(parameter.type === "int32" ? Math.round(value) : value));
    number.value = short(accepted);
    range.value = String(sliderPosition(accepted));
  };
  const sliderValue = () => {
    const position = Number(range.value);
    return isLogarithmic ? min * (max / min) ** position : min + position * (max - min);
  };
  number.addEventListener("change", () => void change(Number(number.value)));
  range.addEventListener("input", () => (number.value = short(parameter.type === "int32" ? Math.round(sliderValue()) : sliderValue())));
  range.addEventListener("change", () => void change(sliderValue()));
  return h("div", { class: "row-of-two" }, range, number);
}
