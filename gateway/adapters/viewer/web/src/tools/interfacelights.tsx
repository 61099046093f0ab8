// The state of the gateway's interfaces as lights, and that of all as one, which opens the list of them.

import type { InterfaceState } from "../protocol";
import type { ConnectionState, Session } from "../session";

export type Light = "bad" | "wait" | "warn" | "good";
/** What several interfaces with a light are, the worst first. */
const STATES: Record<Light, string> = { bad: "failed", wait: "not ready", warn: "with warnings", good: "ready" };
const CONNECTION = { connecting: "connecting …", closed: "reconnecting …" };

/** Return an interface's problem and warnings. */
export function sentencesOf({ problem, warnings = [] }: InterfaceState): string[] {
  return problem ? [problem, ...warnings] : warnings;
}

export function lightOf(each: InterfaceState): Light {
  if (each.state !== "ready") return each.state === "failed" ? "bad" : "wait";
  return sentencesOf(each).length ? "warn" : "good";
}

/** Return an interface's state: `ready`, `2 warnings`. */
export function stateOf(each: InterfaceState): string {
  const { length } = sentencesOf(each);
  return lightOf(each) === "warn" ? `${length} ${length === 1 ? "warning" : "warnings"}` : each.state;
}

/** Return the worst light, and what it says of its interfaces. */
export function summary(connection: ConnectionState, interfaces: InterfaceState[]): { light: Light; text: string } {
  if (connection !== "open") return { light: connection === "closed" ? "bad" : "wait", text: CONNECTION[connection] };
  if (!interfaces.length) return { light: "good", text: "connected" };
  const light = (Object.keys(STATES) as Light[]).find((each) => interfaces.some((one) => lightOf(one) === each))!;
  const [first, ...others] = interfaces.filter((each) => lightOf(each) === light) as [InterfaceState, ...InterfaceState[]];
  if (others.length) return { light, text: `${others.length + 1} interfaces ${STATES[light]}` };
  return { light, text: `${first.title}: ${stateOf(first)}` };
}

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

/** One light for the connection and all interfaces. */
export function InterfaceLights({ session }: { session: Session }) {
  const { state, reason } = session.connection.value;
  const { interfaces = {} } = session.status.value ?? {};
  const { light, text } = summary(state, Object.values(interfaces));
  return (
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
  );
}
