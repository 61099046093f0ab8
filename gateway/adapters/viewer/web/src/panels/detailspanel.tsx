// Panel of the selected node: path, pose, bounds, geometry, opacity, colours of a point cloud.

import { useRef } from "preact/hooks";
import { pathText, short } from "../format";
import type { MapName, TreeNode } from "../model";
import type { PagePart } from "../protocol";
import { MarkFields } from "../tools/marks";
import { FrameField, toFrame } from "../tools/poseframes";
import { COLOR_MAPS, colorChoices, ramp } from "../view/clouds";
import type { Viewer } from "../viewer";
import { Button, Field, Opacity } from "../widgets/controls";
import { describe } from "./describe";

interface NodeProps {
  node: TreeNode;
  viewer: Viewer;
}

/** Colours of a point cloud. */
function CloudColors({ node, part, viewer }: NodeProps & { part: PagePart }) {
  const { by, map } = node.cloud ?? { by: "", map: "turbo" as MapName };
  const range = node.cloudRange;
  const choose = (nextBy: string, nextMap: MapName) => {
    node.cloud = nextBy ? { by: nextBy, map: nextMap } : null;
    viewer.changed(node);
  };
  const maps = Object.keys(COLOR_MAPS).map((name) => [name, name] as [MapName, string]);
  return (
    <>
      <Field label="Colour by" value={by} choices={colorChoices(part)} onChange={(next) => choose(next, map)} />
      <Field label="Colour map" hidden={!by} value={map} choices={maps} onChange={(next) => choose(by, next)} />
      <div hidden={!by}>
        <div class="ramp" style={`background: ${ramp(map)}`} />
        <div class="ramp-ends">
          <span>{range && short(range.low)}</span>
          <span>{range && short(range.high)}</span>
        </div>
      </div>
    </>
  );
}

function Values({ node, viewer }: NodeProps) {
  const element = useRef<HTMLDListElement>(null);
  const rows = useRef<[string, string][]>([]);
  viewer.session.rates.value; // poses are shown once a second
  const selection = getSelection();
  const isBeingCopied = element.current && selection?.isCollapsed === false && selection.containsNode(element.current, true);
  const { model, frame, clicked } = viewer.session;
  if (!isBeingCopied) rows.current = describe(node, toFrame(model, node, frame.value), viewer.boundsOf(node), clicked.value);
  return (
    <dl ref={element}>
      {rows.current.map(([name, value]) => (
        <>
          <dt key={name}>{name}</dt>
          <dd key={`${name}:`}>{value}</dd>
        </>
      ))}
    </dl>
  );
}

export function DetailsPanel({ viewer }: { viewer: Viewer }) {
  const { session } = viewer;
  const { value: node } = session.selected;
  const { value: awaited } = session.awaited;
  session.changes.value;
  const gone = awaited && `${pathText(awaited)} is not in the scene any more. It is selected again when it is published.`;
  const cloud = node?.parts?.find((part) => part.points !== undefined);
  return (
    <section class="details" aria-label="Selection">
      {!node && <p class="empty">{gone ?? "Nothing is selected. Click something in the view or in the tree."}</p>}
      {node && (
        <>
          <header>
            <h2>{pathText(node.path)}</h2>
            <Button icon="fit" class="plain" title="Fit the view to it (F)" onClick={() => viewer.fit(node)}>
              Fit
            </Button>
            <Button
              icon="follow"
              class="plain"
              title="Follow it with the camera (C); again: ride along; again: stop"
              pressed={viewer.follow.modeOf(node) !== null}
              onClick={() => viewer.follow.cycle(node)}
            >
              Follow
            </Button>
            <Button icon="close" aria-label="Deselect" title="Deselect (Esc)" onClick={() => viewer.select(null)} />
          </header>
          <label class="field">
            Opacity
            <Opacity label="Opacity" node={node} changed={viewer.changed} />
            <output>{Math.round(node.shownOpacity * 100)} %</output>
          </label>
          <MarkFields node={node} changed={() => viewer.changed()} />
          {cloud && <CloudColors node={node} part={cloud} viewer={viewer} />}
          <FrameField model={session.model} frame={session.frame} />
          <Values key={node.id} node={node} viewer={viewer} />
        </>
      )}
    </section>
  );
}
