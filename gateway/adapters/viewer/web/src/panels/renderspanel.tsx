// Panel of the last render requests: scene, image, duration or error.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { RenderEntry } from "../protocol";
import type { Session } from "../session";
import type { Panels } from "./panels";

function Item({ render, panels }: { render: RenderEntry; panels: Panels }) {
  const { id, what, error } = render;
  const time = new Date(render.when * 1000).toLocaleTimeString();
  const waited = render.queued >= 1 ? `, ${render.queued.toFixed(0)} ms of it waiting` : "";
  const url = `view/renders/${id}.png`;
  const open = () => panels.open({ title: what, source: () => url, fileName: `render-${id}.png` });
  return (
    <li>
      {render.image ? (
        <button type="button" class="thumb" title="In full size" onClick={open}>
          <img src={`${url}?width=192`} alt={what} loading="lazy" />
        </button>
      ) : (
        <div class="none">{render.status}</div>
      )}
      <div>
        <div class="what">{what}</div>
        <div class="quiet">{`${time} · ${render.milliseconds.toFixed(1)} ms${waited}`}</div>
        <div class={error ? "problem" : "quiet"}>{error || render.scene}</div>
        {render.warnings.map((warning) => (
          <div key={warning} class="warning">
            {warning}
          </div>
        ))}
      </div>
    </li>
  );
}

export function RendersPanel({ session, panels }: { session: Session; panels: Panels }) {
  const active = panels.isActive("Renders");
  const renders = useSignal<RenderEntry[]>([]);
  /** Number of requests at the last download of the list. */
  const last = useRef(0);
  const { value: status } = session.status;
  const known = status?.renders ?? 0;
  const download = async () => {
    if (!status) last.current = -1; // the next gateway has other requests
    if (!active || known === last.current) return;
    last.current = known; // of another gateway, it starts at zero
    const response = known ? await fetch("view/renders").catch(() => null) : null;
    if (response?.ok) renders.value = (await response.json()) as RenderEntry[];
    else if (known) last.current = -1; // the next status message downloads it again
  };
  useEffect(() => void download(), [active, status]);
  return (
    <section aria-label="Recent renders">
      <p class="empty" role="status" hidden={known > 0}>
        {status ? "No render requests yet." : "Waiting for the gateway …"}
      </p>
      <ul class="renders" hidden={known === 0}>
        {renders.value.map((render) => (
          <Item key={render.id} render={render} panels={panels} />
        ))}
      </ul>
    </section>
  );
}
