// The bar below the view: pause, drag, step, rate, loop, live.

import type { TimeState } from "../protocol";
import { isRecorded } from "../resources";
import type { Session } from "../session";
import { Button, Select } from "../widgets/controls";
import { clockText, duration, momentText, type Timeline } from "./timeline";

const RATES = ["0.1", "0.25", "0.5", "1", "2", "5", "10"].map((rate) => [rate, `${rate}×`] as [string, string]);
/** Seconds by which keys move the slider. */
const KEY_SECONDS: Record<string, number> = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 };

function Position({ state, timeline }: { state: TimeState; timeline: Timeline }) {
  const { first, last, position, mode, live } = state;
  const goTo = (at: number) => (live && at >= last ? timeline.live() : timeline.seek(Math.max(at, first)));
  const onKeyDown = (event: KeyboardEvent) => {
    const seconds = KEY_SECONDS[event.key];
    if (seconds) timeline.shift(seconds);
    else if (event.key === "Home") goTo(first);
    else if (event.key === "End") goTo(last);
    else return;
    event.preventDefault();
  };
  return (
    <input
      type="range"
      aria-label="Time"
      aria-valuetext={`${momentText(state)} ${clockText(state)}`}
      title={`The last ${duration(last - first)}`}
      min={first - last}
      max={0}
      step="any"
      value={mode === "live" ? 0 : position - last}
      onInput={({ currentTarget }) => goTo(last + Number(currentTarget.value))}
      onKeyDown={onKeyDown}
    />
  );
}

export function TimeBar({ timeline, session }: { timeline: Timeline; session: Session }) {
  const state = timeline.state.value;
  // The view has its final size before the gateway says whether there is a timeline.
  const isKnown = isRecorded() || session.status.value !== null || session.connection.value.state === "closed";
  if (!state) return isKnown ? null : <div class="timebar" />;
  const { mode, live, rate, loop, working, problem } = state;
  const isLive = mode === "live";
  return (
    <section class={`timebar ${mode}`} aria-label="Time of the scene">
      <Button
        icon={mode === "paused" ? "play" : "pause"}
        title={mode === "paused" ? "Play (P)" : "Pause: the scene goes on, this page stays (P)"}
        onClick={timeline.toggle}
      />
      <span class="steps" hidden={isLive}>
        <Button icon="stepback" title="One change back (,)" onClick={() => timeline.step(-1)} />
        <Button icon="step" title="One change forward (.)" onClick={() => timeline.step(1)} />
      </span>
      <Position state={state} timeline={timeline} />
      <span class="moment" role="status" hidden={isLive}>
        {problem || (working ? "Looking for it …" : momentText(state))} <span class="wide">{!problem && clockText(state)}</span>
      </span>
      <span class="steps" hidden={isLive}>
        <Select label="Rate" value={`${rate}`} choices={RATES} onChange={(text) => timeline.set({ rate: Number(text) })} />
        <Button icon="loop" title="Loop: from the end to the start" pressed={loop} onClick={() => timeline.set({ loop: !loop })} />
      </span>
      {live && (
        <button type="button" class="golive" aria-pressed={isLive} title="The scene as it is now (L)" onClick={timeline.live}>
          Live
        </button>
      )}
    </section>
  );
}
