// Toolbar: panels, the view, measuring, the display menu, downloads.

import { isRecorded } from "../resources";
import { pageFile, rendering, sceneFile, snapshot } from "../tools/downloads";
import type { Viewer } from "../viewer";
import { Button, Download } from "../widgets/controls";
import { Icon } from "../widgets/icons";
import { DisplayMenu } from "./displaymenu";
import type { Panels } from "./panels";

const HOME = "The home view: everything, from the front right, unless a client has set another (H)";
const RENDER = "This view by the gateway's rasterizer, as PNG";
const FILM = "A film of the view as WebM, until the next click (R)";
const PAGE = "This page with the scene and its recent motion in one file, which opens without a gateway";
const FILE = "The visible scene as .glb, with this view as its camera";

export function Toolbar({ viewer, panels }: { viewer: Viewer; panels: Panels }) {
  const { measurement, film } = viewer;
  const word = (text: string) => <span class="word">{text}</span>;
  const panel = "Panels: selection, stereo camera, renders, controls (S)";
  return (
    <header class="bar">
      <Button icon="tree" title="Scene tree (T)" pressed={panels.left.value} onClick={() => panels.toggle("left")} />
      <h1>
        <a class="brand" {...(isRecorded() ? {} : { href: "./", title: "All interfaces of this gateway" })}>
          <Icon name="cube" />
          {word("Scenegate")}
        </a>
      </h1>
      <div class="tools" role="toolbar" aria-label="View">
        <Button icon="fit" title="Fit the selection, or everything (F)" onClick={() => viewer.fit()} />
        <Button icon="home" title={HOME} onClick={() => viewer.look("home")} />
        <Button icon="measure" title="Measure between two points (M)" pressed={measurement.points.value !== null} onClick={measurement.toggle} />
        <span class="gap" />
        <DisplayMenu viewer={viewer} />
        <span class="space" />
        <Button icon="snapshot" title="This view as PNG (I)" onClick={() => snapshot(viewer)}>
          {word("PNG")}
        </Button>
        {film.isPossible && (
          <Button icon="film" class="film" title={FILM} pressed={film.isRecording.value} onClick={film.toggle}>
            {word(film.isRecording.value ? "Stop" : "Film")}
          </Button>
        )}
        {!isRecorded() && (
          <>
            <Download icon="render" title={RENDER} download="scenegate-render.png" url={() => rendering(viewer)}>
              {word("Render")}
            </Download>
            <Download icon="download" title={FILE} download="scene.glb" url={() => sceneFile(viewer)}>
              {word(".glb")}
            </Download>
            <Download icon="share" title={PAGE} download="scene.html" url={pageFile}>
              {word(".html")}
            </Download>
          </>
        )}
      </div>
      <Button icon="panel" title={panel} aria-label={panel} pressed={panels.right.value} onClick={() => panels.toggle("right")}>
        {word("Panels")}
      </Button>
    </header>
  );
}
