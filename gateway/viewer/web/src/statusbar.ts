// Status bar: connection, interfaces, rates, losses.

import { h } from "./dom";
import type { InterfaceState, Status } from "./protocol";

const LIGHTS: Record<string, string> = { ready: "good", starting: "wait", stopped: "wait", failed: "bad" };

export class StatusBar {
  readonly element = h("footer", { class: "status" });
  private readonly connection = h("span", { class: "light wait", role: "status" }, "connecting …");
  private readonly rates = h("span", { class: "rates", title: "Frames drawn and updates received per second" });
  private readonly interfaces = h("span", { class: "interfaces" });
  private readonly facts = h("span", { class: "facts" });
  private shown = "";

  constructor() {
    this.element.append(this.connection, this.interfaces, this.facts, this.rates);
  }

  connected(state: "open" | "closed", reason: string): void {
    this.connection.className = `light ${state === "open" ? "good" : "bad"}`;
    this.connection.textContent = state === "open" ? "connected" : "reconnecting …";
    this.connection.title = reason;
    if (state === "open") return;
    this.interfaces.replaceChildren();
    this.shown = "";
    this.facts.replaceChildren();
  }

  tick(frames: number, updates: number, nodes: number, revision: number): void {
    const wide = (text: string) => h("span", { class: "wide" }, text);
    this.rates.replaceChildren(
      `${nodes} ${nodes === 1 ? "node" : "nodes"}`,
      wide(` · revision ${revision} · ${updates} updates/s`),
      ` · ${frames} fps`,
    );
  }

  show(status: Status): void {
    const interfaces = Object.values(status.interfaces ?? {});
    const text = JSON.stringify(interfaces);
    if (text !== this.shown) this.interfaces.replaceChildren(...interfaces.map(light)); // else an open list would close
    this.shown = text;
    this.facts.replaceChildren(
      ...(status.facts ?? []).map(({ name, value, warn }) => h("span", { class: warn ? "warn" : "" }, `${name} ${value}`)),
    );
  }
}

/** An interface's light: yellow with a list that opens if there is something to say, else a link to its documentation. */
function light({ state, title, documentation, problem, warnings = [] }: InterfaceState): HTMLElement {
  const sentences = problem ? [problem, ...warnings] : warnings;
  const name = documentation ? h("a", { href: documentation, target: "_blank", rel: "noreferrer" }, title) : title;
  if (!sentences.length) return h("span", { class: `light ${LIGHTS[state] ?? ""}`, title: state }, name);
  const color = state === "ready" ? "warn" : (LIGHTS[state] ?? "");
  return h(
    "details",
    { class: "sentences", name: "sentences" },
    h("summary", { class: `light ${color}`, title: sentences.join("\n") }, `${title}: ${count(sentences.length, problem)}`),
    h("ul", {}, ...sentences.map((sentence) => h("li", {}, sentence)), ...(documentation ? [h("li", {}, name)] : [])),
  );
}

function count(sentences: number, problem?: string): string {
  return problem ? "failed" : sentences === 1 ? "1 warning" : `${sentences} warnings`;
}
