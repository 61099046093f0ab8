// The state of the gateway's interfaces as lights, and that of all as one. Without a browser.

import type { InterfaceState } from "./protocol";
import type { ConnectionState } from "./session";

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
