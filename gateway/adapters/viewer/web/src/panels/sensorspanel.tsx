// Panel of the stereo camera: its current images and parameters. Requests images only while it is visible.

import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { StereoCapture } from "../protocol";
import { StereoPose } from "../tools/stereopose";
import type { Viewer } from "../viewer";
import type { Panels } from "./panels";
import { Parameters } from "./parameters";

const IMAGES = { left: "Left", right: "Right", disparity: "Disparity", confidence: "Confidence" } as const;
type Name = keyof typeof IMAGES;
const NAMES = Object.keys(IMAGES) as Name[];
const PERIOD = 500;

export function SensorsPanel({ viewer, panels }: { viewer: Viewer; panels: Panels }) {
  const { session } = viewer;
  const active = panels.isActive("Stereo");
  const state = useSignal<StereoCapture | null>(null);
  const note = useSignal("Waiting for the gateway …");
  const thumbs = useRef<HTMLDivElement>(null);
  const { value: connection } = session.connection;
  const isRequested = active || NAMES.some((name) => panels.full.value?.fileName === `${name}.jpg`);

  const request = async () => {
    const response = await fetch("view/sensor").catch(() => null);
    if (response?.status === 200) {
      state.value = (await response.json()) as StereoCapture;
      note.value = "";
      await Promise.resolve(); // until the images have their new addresses
      await Promise.allSettled([...(thumbs.current?.querySelectorAll("img") ?? [])].map((image) => image.decode()));
    } else if (response) {
      state.value = null;
      note.value = await response.text();
    } else note.value = state.value ? "The gateway does not respond; these are its last images." : "The gateway does not respond.";
  };
  useEffect(() => {
    let timer = 0;
    let ended = !isRequested;
    const poll = async () => {
      if (document.visibilityState === "visible") await request();
      if (!ended) timer = setTimeout(poll, PERIOD);
    };
    if (!ended) void poll();
    return () => {
      ended = true;
      clearTimeout(timer);
    };
  }, [isRequested]);

  const source = (name: Name, query: string) => `view/sensor/${name}.jpg?${query}frame=${state.value?.number}`;
  const open = (name: Name) => panels.open({ title: `${IMAGES[name]}, stereo camera`, source: () => source(name, ""), fileName: `${name}.jpg` });
  return (
    <section class="sensors" aria-label="Stereo camera">
      <p class="empty" role="status" hidden={!note.value}>
        {note}
      </p>
      {state.value && (
        <>
          <div ref={thumbs} class="thumbs">
            {NAMES.map((name) => (
              <figure key={name}>
                <button type="button" class="thumb" title={`${IMAGES[name]} in full size`} data-image={name} onClick={() => open(name)}>
                  <img alt={`${IMAGES[name]} image of the stereo camera`} src={source(name, "width=320&")} />
                </button>
                <figcaption>
                  <span>{IMAGES[name]}</span>
                  <span>{state.value?.captions[name]}</span>
                </figcaption>
              </figure>
            ))}
          </div>
          <StereoPose source={viewer} pose={state.value.pose ?? ""} />
          {active && <Parameters key={connection.state} size={viewer.frustum.imageSize} />}
        </>
      )}
    </section>
  );
}
