// The page: toolbar, tree, view, panels, status bar. On small screens tree and panels are drawers over the view.

import { type Signal, useSignal } from "@preact/signals";
import { refusal } from "./files";
import { keep, kept } from "./options";
import { DetailsPanel } from "./panels/detailspanel";
import { EmptyState } from "./panels/emptystate";
import { Lightbox } from "./panels/lightbox";
import type { Panels, Side, Tab } from "./panels/panels";
import { RendersPanel } from "./panels/renderspanel";
import { SensorsPanel } from "./panels/sensorspanel";
import { ShortcutList } from "./panels/shortcuts";
import { SideViews } from "./panels/sideviews";
import { StatusBar } from "./panels/statusbar";
import { Toolbar } from "./panels/toolbar";
import { TreePanel } from "./panels/treepanel";
import { ControlsPanel } from "./programs/controlspanel";
import type { ProgramControls } from "./programs/programcontrols";
import { isRecorded } from "./resources";
import { FollowBar } from "./tools/follow";
import { MeasureBar } from "./tools/measure";
import { TimeBar } from "./tools/timebar";
import { ViewAxes } from "./tools/viewaxes";
import type { Viewer } from "./viewer";
import { TabList } from "./widgets/controls";

const MIN_WIDTH = 160;
/** Step of an arrow key, pixels. */
const STEP = 16;

/** Handle between a panel and the view: dragged, or moved by the arrow keys. `width`: of the panel, pixels; null: the default. */
function Splitter({ side, label, width }: { side: Side; label: string; width: Signal<number | null> }) {
  const set = (pixels: number | null) => {
    width.value = pixels;
    keep(`${side}-width`, pixels ? String(pixels) : "");
  };
  const moveTo = (x: number) => {
    const pixels = side === "left" ? x : innerWidth - x;
    set(Math.round(Math.min(Math.max(pixels, MIN_WIDTH), 0.6 * innerWidth)));
  };
  const onPointerMove = ({ currentTarget, pointerId, clientX }: PointerEvent) => {
    if ((currentTarget as Element).hasPointerCapture(pointerId)) moveTo(clientX);
  };
  const onKeyDown = (event: KeyboardEvent) => {
    const step = { ArrowLeft: -STEP, ArrowRight: STEP }[event.key];
    if (!step) return;
    moveTo((event.currentTarget as Element).getBoundingClientRect()[side] + step);
    event.preventDefault();
  };
  return (
    <div
      class={`splitter ${side}`}
      role="separator"
      tabIndex={0}
      aria-orientation="vertical"
      aria-label={label}
      aria-valuenow={width.value ?? MIN_WIDTH}
      title="Drag to resize"
      onPointerDown={({ currentTarget, pointerId }) => currentTarget.setPointerCapture(pointerId)}
      onPointerMove={onPointerMove}
      onKeyDown={onKeyDown}
      onDblClick={() => set(null)}
    />
  );
}

type AppProps = { viewer: Viewer; panels: Panels; programControls: ProgramControls };

export function App({ viewer, panels, programControls }: AppProps) {
  const { session } = viewer;
  const widths = { left: useSignal(Number(kept("left-width")) || null), right: useSignal(Number(kept("right-width")) || null) };
  const width = (side: Side) => (widths[side].value ? `--${side}-width: ${widths[side].value}px;` : "");
  const tab = panels.shown.value;
  const tabs = panels.tabs.value;
  const pages: Record<Tab, preact.ComponentChild> = {
    Selection: <DetailsPanel viewer={viewer} />,
    Controls: panels.isActive("Controls") && <ControlsPanel controls={programControls} model={session.model} />,
    Stereo: <SensorsPanel viewer={viewer} panels={panels} />,
    Renders: <RendersPanel session={session} panels={panels} />,
  };
  const { notice, graphicsNotice } = session;
  const isConnected = session.connection.value.state === "open";
  const hint = notice.value.text || refusal.value || graphicsNotice.value;
  const id = (name: Tab) => `page-${name.toLowerCase()}`;
  return (
    <>
      <Toolbar viewer={viewer} panels={panels} />
      <div class={`layout${panels.left.value ? "" : " no-left"}${panels.right.value ? "" : " no-right"}`} style={width("left") + width("right")}>
        <nav class="drawer left">
          <TreePanel viewer={viewer} />
        </nav>
        <main class="stage">
          <div class="view" ref={viewer.attach} />
          <div class="pills">
            <FollowBar follow={viewer.follow} />
            <MeasureBar measurement={viewer.measurement} />
          </div>
          <ViewAxes rig={viewer.stage.rig} rotation={viewer.rotation} />
          <SideViews viewer={viewer} />
          <p class={notice.value.centre ? "hint centre" : "hint"} role="status" hidden={hint === ""}>
            {hint}
          </p>
          {session.isEmpty.value && isConnected && viewer.timeline.isLive.value && !isRecorded() && <EmptyState />}
          <Splitter side="left" label="Width of the scene tree" width={widths.left} />
          <Splitter side="right" label="Width of the panels" width={widths.right} />
        </main>
        <aside class="drawer right" aria-label="Panels">
          <TabList names={tabs} current={tab} controls={id} onSelect={(name) => (panels.tab.value = name)} />
          {tabs.map((name) => (
            <div key={name} class="page" role="tabpanel" id={id(name)} aria-label={name} tabIndex={-1} hidden={name !== tab}>
              {pages[name]}
            </div>
          ))}
        </aside>
        <div class="shade" onClick={() => panels.closeDrawers()} />
      </div>
      <TimeBar timeline={viewer.timeline} session={session} />
      <StatusBar session={session} />
      <ShortcutList viewer={viewer} panels={panels} />
      <Lightbox panels={panels} />
    </>
  );
}
