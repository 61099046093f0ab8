// The page. Its files import one way, which tests/layers.test.ts holds: protocol, format, options, resources (textures, of the
// gateway or of a recording), files -> connection, recorded/ -> model -> session -> widgets/ -> view/ -> programs/ (controls and
// gizmos of programs) -> tools/ -> viewer (stage, drawing and tools of a session) -> panels/ -> app -> main.

import { effect } from "@preact/signals";
import { h, render } from "preact";
import { Box3 } from "three";
import "./style.css";
import { App } from "./app";
import { Connection } from "./connection";
import { Panels, type Tab } from "./panels/panels";
import { listenForShortcuts } from "./panels/shortcuts";
import { Gizmos } from "./programs/gizmos";
import { ProgramControls } from "./programs/programcontrols";
import type { Message } from "./protocol";
import { RecordedConnection } from "./recorded/recordedconnection";
import { isRecorded } from "./resources";
import { Viewer } from "./viewer";

const report: Connection["report"] = (message) => connection.report(message);
const viewer = new Viewer(report, () => panels.show("Selection"));
const { session, stage } = viewer;
const programControls = new ProgramControls(report);
const panels = new Panels(session, programControls);
const gizmos = new Gizmos(stage, session.model, programControls);
render(h(App, { viewer, panels, programControls }), document.querySelector("#app") as Element);
viewer.followAddress();

let hasNewMeshes = false;

type Handlers = { [K in Message["kind"]]: (message: Extract<Message, { kind: K }>) => void };
const handlers: Handlers = {
  update: (message) => {
    viewer.apply(message);
    gizmos.follow();
    if (hasNewMeshes) dropUnusedMeshes();
    connection.acknowledge("k");
  },
  mesh: (message) => {
    session.model.meshes.set(message.id, message);
    hasNewMeshes = !isRecorded(); // a recording has sent all of its meshes
  },
  forget: ({ meshes }) => viewer.drawing.forget(meshes),
  rig: (message) => viewer.frustum.show(message),
  light: (message) => viewer.light(message),
  page: (message) => viewer.configure(message),
  controls: (message) => {
    programControls.receive(message);
    connection.acknowledge("c");
  },
  received: ({ number }) => programControls.received(number),
  status: (message) => {
    session.status.value = message;
    viewer.timeline.settle();
  },
  time: (message) => viewer.timeline.receive(message),
};
const receive = (message: Message) => (handlers[message.kind] as (message: Message) => void)(message);

const connection = new (isRecorded() ? RecordedConnection : Connection)(receive, (state, reason) => {
  if (state === "open") {
    viewer.drawing.reset();
    programControls.reset();
    viewer.timeline.restore();
  }
  session.setConnection(state, reason);
});

/** Drop meshes of earlier states. Between an update and its acknowledgement, no other update is on its way. */
function dropUnusedMeshes(): void {
  hasNewMeshes = false;
  const unused = session.model.unusedMeshes();
  viewer.drawing.forget(unused);
  for (let first = 0; first < unused.length; first += 500) connection.report({ forgot: unused.slice(first, first + 500) });
}

const isDemo = () => {
  const { interfaces = {} } = session.status.value ?? {};
  return "demo" in interfaces && "stereo" in interfaces;
};

/** Open a panel when it has content for the first time. */
function openFor(tab: Tab, hasContent: () => boolean): void {
  const stop = effect(() => {
    if (!hasContent()) return;
    panels.show(tab);
    queueMicrotask(() => stop());
  });
}
effect(() => viewer.frustum.setShown(session.streaming.value || panels.isActive("Stereo")));
openFor("Stereo", () => session.streaming.value || isDemo());
openFor("Controls", () => programControls.all.value.length > 0);

listenForShortcuts(viewer, panels);

setInterval(() => {
  if (session.tick(stage.frames)) viewer.placeShadows(); // the scene may have moved
  if (document.hidden) stage.materials.disposeUnused(); // nothing is drawn
}, 1000);

// For tests and the console.
const { model } = session;
const { drawing, frustum, select, fit } = viewer;
Object.assign(window, { scenegate: { model, drawing, stage, rig: stage.rig, frustum, light: viewer.viewLight, select, fit, Box3 } });
