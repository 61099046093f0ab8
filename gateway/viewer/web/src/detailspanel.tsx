// Panel of the selected node: path, pose, bounds, geometry, opacity, colours of a point cloud.

import { useRef } from "preact/hooks";
import { type Box3, Euler, Quaternion, Vector3 } from "three";
import { colorChoices } from "./clouds";
import { COLOR_MAPS, type MapName, ramp } from "./colormaps";
import { Button, Select, Slider } from "./controls";
import { counted, pathText, short, shortRow } from "./format";
import type { TreeNode } from "./model";
import type { Part } from "./protocol";
import type { Viewer } from "./viewer";

interface NodeProps {
  node: TreeNode;
  viewer: Viewer;
}

function Opacity({ node, viewer }: NodeProps) {
  const set = (opacity: number) => {
    node.ownOpacity = opacity;
    viewer.changed(node);
  };
  return (
    <label class="field">
      Opacity
      <Slider label="Opacity" value={node.shownOpacity} onInput={set} />
      <output>{Math.round(node.shownOpacity * 100)} %</output>
    </label>
  );
}

/** Colours of a point cloud. */
function CloudColors({ node, part, viewer }: NodeProps & { part: Part }) {
  const { by, map } = node.cloud ?? { by: "", map: "turbo" as MapName };
  const range = node.cloudRange;
  const choose = (nextBy: string, nextMap: MapName) => {
    node.cloud = nextBy ? { by: nextBy, map: nextMap } : null;
    viewer.changed(node);
  };
  const maps = Object.keys(COLOR_MAPS).map((name) => [name, name] as [MapName, string]);
  return (
    <>
      <label class="field">
        Colour by
        <Select label="Colour by" value={by} choices={colorChoices(part)} onChange={(next) => choose(next, map)} />
      </label>
      <label class="field" hidden={!by}>
        Colour map
        <Select label="Colour map" value={map} choices={maps} onChange={(next) => choose(by, next)} />
      </label>
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

function partText(part: Part): string {
  const points = part.points === undefined ? "" : `${part.points} points`;
  return [part.kind, points, Object.keys(part.channels ?? {}).join(", "), part.source].filter(Boolean).join(" · ");
}

/** Return names and values of a node's current pose, bounds and geometry. */
export function describe(node: TreeNode, box: Box3): [string, string][] {
  const position = new Vector3();
  const rotation = new Quaternion();
  const scale = new Vector3();
  node.world.decompose(position, rotation, scale);
  const angles = new Euler().setFromQuaternion(rotation, "ZYX");
  const degrees = [angles.x, angles.y, angles.z].map((angle) => (angle * 180) / Math.PI);
  const size = box.getSize(new Vector3());
  const metres = Math.min(1000, Math.max(size.x, size.y, size.z, position.length()));
  const rows: [string, string][] = [
    ["Position in the world (x y z, m)", shortRow(position.toArray(), metres)],
    ["Roll, pitch, yaw (degrees)", shortRow(degrees, 360)],
    ["Quaternion (w x y z)", shortRow([rotation.w, rotation.x, rotation.y, rotation.z])],
  ];
  if (scale.distanceTo(new Vector3(1, 1, 1)) > 1e-6) rows.push(["Scale", shortRow(scale.toArray())]);
  if (!box.isEmpty()) {
    rows.push(["Bounding box (m)", [box.min, box.max].map((corner) => shortRow(corner.toArray(), metres)).join("\n")]);
    rows.push(["Size (m)", shortRow(size.toArray(), metres)]);
  }
  rows.push(["Geometry", counted((node.parts ?? []).map(partText)).join("\n") || "none"]);
  if (node.children.size) rows.push(["Children", String(node.children.size)]);
  return rows;
}

function Values({ node, viewer }: NodeProps) {
  const element = useRef<HTMLDListElement>(null);
  const rows = useRef<[string, string][]>([]);
  viewer.session.rates.value; // poses are shown once a second
  const selection = getSelection();
  const isBeingCopied = element.current && selection?.isCollapsed === false && selection.containsNode(element.current, true);
  if (!isBeingCopied) rows.current = describe(node, viewer.boundsOf(node));
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
            <Button icon="close" aria-label="Deselect" title="Deselect (Esc)" onClick={() => viewer.select(null)} />
          </header>
          <Opacity node={node} viewer={viewer} />
          {cloud && <CloudColors node={node} part={cloud} viewer={viewer} />}
          <Values key={node.id} node={node} viewer={viewer} />
        </>
      )}
    </section>
  );
}
