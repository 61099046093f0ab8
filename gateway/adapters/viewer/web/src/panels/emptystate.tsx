// Panel over the view while the scene is empty: three ways to publish, as code to copy.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { CopyButton, TabList } from "../widgets/controls";

const CODE_ID = "empty-state-code";

/** Code to publish on a hub, by its URL; by title of the tab. */
const EXAMPLES = {
  Python: (hub: string) => `from scenegate import Box, TreeViewer

with TreeViewer("${hub}") as viewer:
    viewer["box"].set(Box((0.4, 0.3, 0.2), color="orange"))`,
  "A file": (hub: string) => `scenegate publish robot.glb --lcm-url ${hub}
scenegate publish panda.urdf --lcm-url ${hub}`,
  Drake: (hub: string) => `from pydrake.lcm import DrakeLcm
from pydrake.visualization import ApplyVisualizationConfig, VisualizationConfig

lcm = DrakeLcm("${hub}")
ApplyVisualizationConfig(VisualizationConfig(), builder, lcm=lcm)`,
};
type Title = keyof typeof EXAMPLES;

/** Return the URL of this gateway's hub. Without a required token, `/healthz` does not have it; the default is then right. */
async function findHub(): Promise<string | null> {
  const response = await fetch("healthz").catch(() => null);
  if (!response?.ok) return null;
  const { interfaces } = (await response.json()) as { interfaces?: { treeviewer?: { tcpq?: { url?: string } } } };
  return interfaces?.treeviewer?.tcpq?.url?.replace(/\/\/(0\.0\.0\.0|\[::\])/, `//${location.hostname}`) ?? null;
}

export function EmptyState() {
  const title = useSignal<Title>("Python");
  const hub = useSignal("tcpq://127.0.0.1:7700");
  const code = useRef<HTMLElement>(null);
  useEffect(() => void findHub().then((url) => (hub.value = url ?? hub.value)), []);
  const text = EXAMPLES[title.value](hub.value);
  return (
    <section class="empty-state" aria-label="The scene is empty">
      <h2>The scene is empty</h2>
      <p>Publish something, and it appears here:</p>
      <TabList names={Object.keys(EXAMPLES) as Title[]} current={title.value} controls={() => CODE_ID} onSelect={(name) => (title.value = name)} />
      <div class="code" role="tabpanel" id={CODE_ID} aria-label="Code">
        <pre tabIndex={0}>
          <code ref={code}>{text}</code>
        </pre>
        <CopyButton title="Copy the code" text={text} shown={code} />
      </div>
      <p class="quiet">
        Or start the gateway with <code>--demo</code> for a moving scene.
      </p>
    </section>
  );
}
