// Status bar: connection, interfaces, rates, losses.

import type { InterfaceState } from "./protocol";
import type { Session } from "./session";

const LIGHTS: Record<string, string> = { ready: "good", starting: "wait", stopped: "wait", failed: "bad" };
const CONNECTION = {
  connecting: { light: "wait", text: "connecting …" },
  open: { light: "good", text: "connected" },
  closed: { light: "bad", text: "reconnecting …" },
};

/** An interface's light: yellow with a list that opens if there is something to say, else a link to its documentation. */
function Light({ state, title, documentation, problem, warnings = [] }: InterfaceState) {
  const sentences = problem ? [problem, ...warnings] : warnings;
  const name = documentation ? (
    <a href={documentation} target="_blank" rel="noreferrer">
      {title}
    </a>
  ) : (
    title
  );
  if (!sentences.length)
    return (
      <span class={`light ${LIGHTS[state] ?? ""}`} title={state}>
        {name}
      </span>
    );
  const color = state === "ready" ? "warn" : (LIGHTS[state] ?? "");
  const count = problem ? "failed" : sentences.length === 1 ? "1 warning" : `${sentences.length} warnings`;
  return (
    <details class="sentences" name="sentences">
      <summary class={`light ${color}`} title={sentences.join("\n")}>{`${title}: ${count}`}</summary>
      <ul>
        {sentences.map((sentence) => (
          <li key={sentence}>{sentence}</li>
        ))}
        {documentation && <li>{name}</li>}
      </ul>
    </details>
  );
}

export function StatusBar({ session }: { session: Session }) {
  const { state, reason } = session.connection.value;
  const { nodes, revision, updates, frames } = session.rates.value;
  const { interfaces = {}, facts = [] } = session.status.value ?? {};
  return (
    <footer class="status">
      <span class={`light ${CONNECTION[state].light}`} role="status" title={reason}>
        {CONNECTION[state].text}
      </span>
      <span class="interfaces">
        {Object.entries(interfaces).map(([name, each]) => (
          <Light key={name} {...each} />
        ))}
      </span>
      <span class="facts">
        {facts.map(({ name, value, warn }) => (
          <span key={name} class={warn ? "warn" : ""}>{`${name} ${value}`}</span>
        ))}
      </span>
      <span class="rates" title="Frames drawn and updates received per second">
        {`${nodes} ${nodes === 1 ? "node" : "nodes"}`}
        <span class="wide">{` · revision ${revision} · ${updates} updates/s`}</span>
        {` · ${frames} fps`}
      </span>
    </footer>
  );
}
