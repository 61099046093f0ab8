// Status bar: one light for the connection and all interfaces, facts, rates.

import { lightOf, sentencesOf, stateOf, summary } from "./interfacelights";
import type { InterfaceState } from "./protocol";
import type { Session } from "./session";

function Interface(each: InterfaceState) {
  const { title, documentation } = each;
  const name = documentation ? (
    <a href={documentation} target="_blank" rel="noreferrer">
      {title}
    </a>
  ) : (
    title
  );
  return (
    <li>
      <span class={`light ${lightOf(each)}`}>
        {name}: {stateOf(each)}
      </span>
      {sentencesOf(each).map((sentence) => (
        <p key={sentence}>{sentence}</p>
      ))}
    </li>
  );
}

export function StatusBar({ session }: { session: Session }) {
  const { state, reason } = session.connection.value;
  const { nodes, revision, updates, frames } = session.rates.value;
  const { interfaces = {}, facts = [] } = session.status.value ?? {};
  const { light, text } = summary(state, Object.values(interfaces));
  return (
    <footer class="status">
      <details>
        <summary title="The state of all interfaces">
          <span class={`light ${light}`} role="status">
            {text}
          </span>
        </summary>
        <ul>
          {state !== "open" && <li>{reason || "The gateway does not respond yet."}</li>}
          {Object.entries(interfaces).map(([name, each]) => (
            <Interface key={name} {...each} />
          ))}
        </ul>
      </details>
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
