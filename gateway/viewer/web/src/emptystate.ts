// Panel over the view while the scene is empty: three ways to publish, as code to copy.

import { h } from "./dom";
import { icon } from "./icons";
import { TabList } from "./tabs";

const CODE_ID = "empty-state-code";
const DEFAULT_HUB = "tcpq://127.0.0.1:7700";

/** Code to publish on a hub, by its URL; by title of the tab. */
const EXAMPLES: Record<string, (hub: string) => string> = {
  Python: (hub) => `from scenegate import Box, TreeViewer

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
  private readonly tabs = new TabList(Object.keys(EXAMPLES), () => CODE_ID, (title) => this.show(title));
  private readonly code = h("code");
  private readonly copy = h("button", { class: "plain", title: "Copy the code", onclick: () => void this.copyCode() });
  private title = "Python";
  private hub = DEFAULT_HUB;

  constructor() {
    this.element.append(
      h("h2", {}, "The scene is empty"),
      h("p", {}, "Publish something, and it appears here:"),
      this.tabs.element,
      h("div", { class: "code", role: "tabpanel", id: CODE_ID, "aria-label": "Code" }, h("pre", { tabindex: 0 }, this.code), this.copy),
      h("p", { class: "quiet" }, "Or start the gateway with ", h("code", {}, "--demo"), " for a moving scene."),
    );
    this.show(this.title);
  }

  setShown(on: boolean): void {
    if (on && this.element.hidden) void this.findHub();
    this.element.hidden = !on;
  }

  private show(title: string): void {
    this.title = title;
    this.tabs.select(title);
    this.code.textContent = EXAMPLES[title]?.(this.hub) ?? "";
    this.labelCopyButton("Copy");
  }

  /** Use the hub of this gateway in the code. Without a required token, `/healthz` does not have it; the default then stays. */
  private async findHub(): Promise<void> {
    const response = await fetch("healthz").catch(() => null);
    if (!response?.ok) return;
    const { interfaces } = (await response.json()) as { interfaces?: { treeviewer?: { tcpq?: { url?: string } } } };
    const url = interfaces?.treeviewer?.tcpq?.url;
    if (url) this.hub = url.replace(/\/\/(0\.0\.0\.0|\[::\])/, `//${location.hostname}`);
    this.show(this.title);
  }

  private async copyCode(): Promise<void> {
    if (await copyText(this.code.textContent ?? "")) return this.labelCopyButton("Copied");
    getSelection()?.selectAllChildren(this.code);
    this.labelCopyButton("Selected: press Ctrl+C");
  }

  private labelCopyButton(text: string): void {
    this.copy.replaceChildren(icon("copy"), text);
  }
}

/** Copy a text. Return false if the browser does not allow it: it does over HTTPS and on localhost. */
async function copyText(text: string): Promise<boolean> {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    return false;
  }
}
