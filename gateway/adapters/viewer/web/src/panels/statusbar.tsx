// Status bar: a light for all interfaces, facts, rates.

import { softwareDevice } from "../options";
import { isRecorded } from "../resources";
import type { Session } from "../session";
import { InterfaceLights } from "../tools/interfacelights";

export function StatusBar({ session }: { session: Session }) {
  const { nodes, revision, updates, frames } = session.rates.value;
  const { facts = [] } = session.status.value ?? {};
  return (
    <footer class="status">
      {isRecorded() ? <span>recorded</span> : <InterfaceLights session={session} />}
      <span class="facts">
        {facts.map(({ name, value, warn }) => (
          <span key={name} class={warn ? "warn" : ""}>{`${name} ${value}`}</span>
        ))}
      </span>
      <span class="rates" title="Frames drawn and updates received per second">
        {`${nodes} ${nodes === 1 ? "node" : "nodes"}`}
        <span class="wide">{` · revision ${revision} · ${updates} updates/s`}</span>
        {` · ${frames} fps`}
        {softwareDevice && (
          <span title="This browser draws on the processor: shadows are off, and moving scenes are slower">{` · ${softwareDevice}`}</span>
        )}
      </span>
    </footer>
  );
}
