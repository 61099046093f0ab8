import { effect } from "@preact/signals";
import { h, render } from "preact";
import { Box3 } from "three";
import "./style.css";
import { App } from "./app";
import { Connection } from "./connection";
import { Gizmos } from "./gizmos";
import { options } from "./options";
import { Panels, type Tab } from "./panels";
import { ProgramControls } from "./programcontrols";
import type { Message } from "./protocol";
import { Session } from "./session";
import { Viewer } from "./viewer";

const session = new Session();
const programControls = new ProgramControls((change) => connection.report(change));
const panels = new Panels(session, programControls);
const holder = document.createElement("div");
const viewer = new Viewer(session, panels, holder, (click) => connection.report(click));
const { stage } = viewer;
const gizmos = new Gizmos(stage, session.model, programControls);
const attach = (element: Element | null) => element?.append(holder);
render(h(App, { viewer, programControls, attach }), document.querySelector("#app") as Element);
viewer.followAddress();

function receive(message: Message): void {
  switch (message.kind) {
    case "update":
      viewer.apply(message);
      gizmos.follow();
      connection.acknowledge();
      break;
    case "mesh":
      session.model.meshes.set(message.id, message);
      break;
    case "forget":
      viewer.drawing.forget(message.meshes);
      break;
    case "rig":
      viewer.frustum.show(message);
      break;
    case "page":
      viewer.configure(message);
      break;
    case "controls":
      programControls.receive(message);
      connection.acknowledgeControls();
      break;
    case "received":
      programControls.received(message.number);
      break;
    case "status":
      session.status.value = message;
      break;
  }
}

const connection = new Connection(receive, (state, reason) => {
  if (state === "open") {
    viewer.drawing.reset();
    programControls.reset();
  }
  session.setConnection(state, reason);
});

/** Open a panel when it has content for the first time. */
function openFor(tab: Tab, hasContent: () => boolean): void {
  const stop = effect(() => {
    if (!hasContent()) return;
    panels.show(tab);
    queueMicrotask(() => stop());
  });
}
openFor("Stereo", () => session.streaming.value);
openFor("Controls", () => programControls.all.value.length > 0);

const KEYS: Record<string, () => unknown> = {
  f: () => viewer.fit(),
  c: () => viewer.cycleFollow(),
  h: () => viewer.look("home"),
  1: () => viewer.look("top"),
  2: () => viewer.look("front"),
  3: () => viewer.look("side"),
  "+": () => stage.zoom(0.8),
  "=": () => stage.zoom(0.8),
  "-": () => stage.zoom(1.25),
  m: () => viewer.measurement.toggle(),
  t: () => panels.toggle("left"),
  s: () => panels.toggle("right"),
  Escape: () => panels.closeDrawers() || viewer.measurement.stop() || viewer.select(null),
};
addEventListener("keydown", (event) => {
  if (event.defaultPrevented || event.ctrlKey || event.metaKey || event.altKey || panels.full.value) return;
  if (event.key === "Escape" && document.querySelector(":popover-open")) return; // it closes the menu
  const { target } = event;
  if ((target instanceof HTMLInputElement && target.type !== "checkbox") || target instanceof HTMLSelectElement) return;
  // Assistive programs type single characters by mistake: they can be switched off where the view does not have the focus.
  const isCharacter = event.key.length === 1;
  if (isCharacter && options.shortcuts.shown.value === "off" && target !== stage.canvas) return;
  KEYS[isCharacter ? event.key.toLowerCase() : event.key]?.();
});

setInterval(() => {
  if (session.tick(stage.frames)) viewer.placeShadows(); // the scene may have moved
  if (document.hidden) viewer.materials.disposeUnused(); // nothing is drawn
}, 1000);

// For tests and the console.
const { model } = session;
const { drawing, frustum, select, fit } = viewer;
Object.assign(window, { scenegate: { model, drawing, stage, frustum, select, fit, Box3 } });
