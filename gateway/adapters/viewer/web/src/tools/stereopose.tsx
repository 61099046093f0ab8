// The stereo camera placed where the view's camera is, and its pose as text for the command line.

import { useRef } from "preact/hooks";
import { refuse, say } from "../files";
import { cameraText } from "../view/camera";
import type { CameraRig } from "../view/camerarig";
import type { Frustum } from "../view/frustum";
import { Button, CopyButton } from "../widgets/controls";

/** View and stereo camera of the page. */
type Source = { stage: { rig: Pick<CameraRig, "view" | "perspective"> }; frustum: Pick<Frustum, "hasPose"> };

/** Place the left camera where the view's camera is, looking the same way. */
export async function placeStereo({ stage: { rig }, frustum }: Source): Promise<void> {
  if (!frustum.hasPose) return say("There is no stereo camera in this scene.");
  const pose = cameraText(rig.view, rig.perspective.fov, rig.perspective.aspect);
  const response = await fetch(`cameras/0/pose?${new URLSearchParams({ pose })}`, { method: "PUT" }).catch(() => null);
  if (!response?.ok) await refuse("The stereo camera stays", response);
}

/** @param pose of the left camera, as text for `--stereo-pose` */
export function StereoPose({ source, pose }: { source: Source; pose: string }) {
  const code = useRef<HTMLElement>(null);
  const text = `--stereo-pose '${pose}'`;
  return (
    <div class="stereo-pose">
      <code ref={code}>
        {text.split(/(?<=[ ;])/).map((part) => (
          <>
            {part}
            <wbr />
          </>
        ))}
      </code>
      <Button icon="follow" class="plain" title="Place the left camera where this view is seen from (V)" onClick={() => placeStereo(source)}>
        Place at this view
      </Button>
      <CopyButton title="Copy the pose for the command line" text={text} shown={code} />
    </div>
  );
}
