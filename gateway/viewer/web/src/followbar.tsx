// Over the view: the node that the camera follows, how, and a button to stop.

import { Button, Select } from "./controls";
import type { FollowMode } from "./follow";
import { pathText } from "./format";
import { Icon } from "./icons";
import type { Viewer } from "./viewer";

const MODES: [FollowMode, string][] = [
  ["follow", "keeps its heading"],
  ["ride", "rides along"],
];

export function FollowBar({ viewer }: { viewer: Viewer }) {
  const { followed, isThere } = viewer.follow;
  if (!followed.value) return null;
  const { path, mode } = followed.value;
  const name = pathText(path);
  return (
    <div class="pill" role="group" aria-label="The camera follows a node">
      <Icon name="follow" />
      <span class="name" title={name}>
        {name}
      </span>
      {!isThere.value && <span class="quiet">is not in the scene</span>}
      <Select label="The camera" value={mode} choices={MODES} onChange={viewer.setFollowMode} />
      <Button icon="close" title="Stop following (C)" onClick={() => viewer.followNode(null)} />
    </div>
  );
}
