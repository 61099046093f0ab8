// Beside the view: the scene from above, and the image of a camera.

import { pathText } from "../format";
import type { Path } from "../protocol";
import { isRecorded } from "../resources";
import type { Viewer } from "../viewer";
import { Check, Field } from "../widgets/controls";

/** Size of a camera's image, pixels. */
const SIZE = "width=480&height=360";

/** Return the name of a camera in the gateway's syntax. */
function cameraName(camera: string): string {
  return camera.startsWith("path:") ? pathText(JSON.parse(camera.slice(5)) as Path) : "Stereo camera";
}

export function SideViews({ viewer: { topView, sideCamera, session, stage, timeline } }: { viewer: Viewer }) {
  const camera = sideCamera.value;
  const { value: moment } = timeline.moment;
  const image = moment === null ? "stream.mjpg?" : `frame.jpg?look=plain&time=${moment}&`;
  if (!topView.isShown.value && !camera) return null;
  const attach = (element: Element | null) => {
    element?.append(topView.canvas);
    stage.redraw();
  };
  return (
    <div class="sideviews" role="group" aria-label="Beside the view">
      {topView.isShown.value && (
        <figure>
          <div ref={attach} />
          <figcaption>From above</figcaption>
        </figure>
      )}
      {camera && (
        <figure key={camera + image + session.connection.value.state}>
          <img src={`view/${image}camera=${encodeURIComponent(camera)}&${SIZE}`} alt={`No image of ${cameraName(camera)} now`} />
          <figcaption>{cameraName(camera)}</figcaption>
        </figure>
      )}
    </div>
  );
}

/** Choices of the display menu: the view from above, and the camera. */
export function SideViewFields({ viewer: { topView, sideCamera, session, stage } }: { viewer: Viewer }) {
  const cameras = new Map([["", "None"]]);
  if (session.status.value?.interfaces?.stereo) cameras.set("stereo", "Stereo camera");
  const { value: selected } = session.selected;
  const ofNode = selected ? `path:${JSON.stringify(selected.path)}` : "";
  for (const camera of [sideCamera.value, ofNode]) if (camera && !cameras.has(camera)) cameras.set(camera, cameraName(camera));
  return (
    <>
      {stage.renderer && (
        <Check
          text="From above"
          title="Around the target of the view"
          checked={topView.isShown.value}
          onChange={(on) => (topView.isShown.value = on)}
        />
      )}
      {!isRecorded() && <Field label="Image of" value={sideCamera.value} choices={[...cameras]} onChange={(camera) => (sideCamera.value = camera)} />}
    </>
  );
}
