// What the view shows while the scene is empty: three ways to publish, as code to copy.

import { h } from "./dom";
import { icon } from "./icons";
import { TabList } from "./tabs";

const CODE_ID = "empty-state-code";
const DEFAULT_HUB = "tcpq://127.0.0.1:7700";

/** Ways to publish: title, and code for a hub. */
const WAYS: Record<string, (hub: string) => string> = {
  Python: (hub) => `from gateway.client import Box, TreeViewer

with TreeViewer("${hub}") as viewer:
    viewer["box"].set(Box((0.4, 0.3, 0.2), color="orange"))`,
  "A file": (hub) => `scenegate publish robot.glb --lcm-url ${hub}
scenegate publish panda.urdf --lcm-url ${hub}`,
  Drake: (hub) => `from pydrake.lcm import DrakeLcm
from pydrake.visualization import ApplyVisualizationConfig, VisualizationConfig

lcm = DrakeLcm("${hub}")
ApplyVisualizationConfig(VisualizationConfig(), builder, lcm=lcm)`,
};

export class EmptyState {
  readonly element = h("section", { class: "empty-state", "aria-label": "The scene is empty", hidden: true });
  private readonly tabs = new TabList(Object.keys(WAYS), () => CODE_ID, (name) => this.show(name));
  private readonly code = h("code");
  private readonly copy = h("button", { class: "plain", title: "Copy the code", onclick: () => void this.copyCode() });
  private way = "Python";
  private hub = DEFAULT_HUB;

  constructor() {
    this.element.append(
      h("h2", {}, "The scene is empty"),
      h("p", {}, "Publish something, and it appears here:"),
      this.tabs.element,
      h("div", { class: "code", role: "tabpanel", id: CODE_ID, "aria-label": "Code" }, h("pre", { tabindex: 0 }, this.code), this.copy),
      h("p", { class: "quiet" }, "Or start the gateway with ", h("code", {}, "--demo"), " for a moving scene."),
    );
    this.show(this.way);
  }

  setShown(on: boolean): void {
    if (on && this.element.hidden) void this.findHub();
    this.element.hidden = !on;
  }

  private show(name: string): void {
    this.way = name;
    this.tabs.select(name);
    this.code.textContent = WAYS[name]?.(this.hub) ?? "";
    this.sayCopy("Copy");
  }

  /** Ask the gateway where its hub listens; with a token it does not say, and the default stays. */
  private async findHub(): Promise<void> {
    const response = await fetch("/healthz").catch(() => null);
    if (!response?.ok) return;
    const { interfaces } = (await response.json()) as { interfaces?: { treeviewer?: { tcpq?: { url?: string } } } };
    const url = interfaces?.treeviewer?.tcpq?.url;
    if (url) this.hub = url.replace(/\/\/(0\.0\.0\.0|\[::\])/, `//${location.hostname}`);
    this.show(this.way);
  }

  private async copyCode(): Promise<void> {
    if (await copyText(this.code.textContent ?? "")) return this.sayCopy("Copied");
    getSelection()?.selectAllChildren(this.code);
    this.sayCopy("Selected: press Ctrl+C");
  }

  private sayCopy(text: string): void {
    this.copy.replaceChildren(icon("copy"), text);
  }
}

/** Copy a text; browsers allow it only over HTTPS and on localhost. */
async function copyText(text: string): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false;
  }
}
