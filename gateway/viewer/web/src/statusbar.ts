// Status bar: connection, interfaces, rates, losses.

import { h } from "./dom";
import type { Status } from "./protocol";

const LIGHTS: Record<string, string> = { ready: "good", starting: "wait", stopped: "wait", failed: "bad" };

export class StatusBar {
  readonly element = h("footer", { class: "status" });
  private readonly connection = h("span", { class: "light wait", role: "status" }, "connecting …");
  private readonly rates = h("span", { class: "rates", title: "Frames drawn and updates received per second" });
  private readonly interfaces = h("span", { class: "interfaces" });
  private readonly facts = h("span", { class: "facts" });

  constructor() {
    this.element.append(this.connection, this.interfaces, this.facts, this.rates);
  }

  connected(state: "open" | "closed", reason: string): void {
    this.connection.className = `light ${state === "open" ? "good" : "bad"}`;
    this.connection.textContent = state === "open" ? "connected" : "reconnecting …";
    this.connection.title = reason;
    if (state === "open") return;
    this.interfaces.replaceChildren();
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
    this.interfaces.replaceChildren(
      ...Object.values(status.interfaces ?? {}).map(({ state, title, documentation, problem }) =>
        h(
          "span",
          { class: `light ${LIGHTS[state] ?? ""}`, title: problem ? `${state}: ${problem}` : state },
          documentation ? h("a", { href: documentation, target: "_blank", rel: "noreferrer" }, title) : title,
        ),
      ),
    );
    this.facts.replaceChildren(
      ...(status.facts ?? []).map(({ name, value, warn }) => h("span", { class: warn ? "warn" : "" }, `${name} ${value}`)),
    );
  }
}
