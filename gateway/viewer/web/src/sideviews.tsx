// Beside the view: the scene from above, and the image of a camera.

import { pathText } from "./format";
import type { Path } from "./protocol";
import type { Viewer } from "./viewer";

/** Size of a camera's image, pixels. */
const SIZE = "width=480&height=360";

/** Return the name of a camera in the gateway's syntax. */
export function cameraName(camera: string): string {
  return camera.startsWith("path:") ? pathText(JSON.parse(camera.slice(5)) as Path) : "Stereo camera";
}

export function SideViews({ viewer }: { viewer: Viewer }) {
  const { hasTopView, sideCamera, topView, session } = viewer;
  const camera = sideCamera.value;
  if (!hasTopView.value && !camera) return null;
  const attach = (element: Element | null) => {
    element?.append(topView.canvas);
    viewer.stage.redraw();
  };
  return (
    <div class="sideviews" role="group" aria-label="Beside the view">
      {hasTopView.value && (
        <figure>
          <div ref={attach} />
          <figcaption>From above</figcaption>
        </figure>
      )}
      {camera && (
        <figure key={camera + session.connection.value.state}>
          <img src={`view/stream.mjpg?camera=${encodeURIComponent(camera)}&${SIZE}`} alt={`No image of ${cameraName(camera)} now`} />
          <figcaption>{cameraName(camera)}</figcaption>
        </figure>
      )}
    </div>
  );
}
