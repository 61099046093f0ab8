// The binary frames of gateway/viewer/frames.py: a JSON header that refers to arrays in the body.

import type { ControlsMessage, Received } from "./programs/controlmessages";
import type { Forget, MeshPayload, PageSettings, Rig, SceneUpdate, Status } from "./protocol";

export type Message = SceneUpdate | MeshPayload | Forget | Status | Rig | PageSettings | ControlsMessage | Received;

const MAGIC = 0x31564753;
/** [offset in bytes, number of values] */
type Span = [number, number];
const NOTHING: Span = [0, 0];
type Transforms = { ids: Span; values: Span };

/** Parse a frame. The typed arrays share the message's memory. */
export function parse(buffer: ArrayBuffer): Message {
  const view = new DataView(buffer);
  if (buffer.byteLength < 8 || view.getUint32(0, true) !== MAGIC) throw new Error("not a view frame");
  const start = 8 + view.getUint32(4, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, start - 8)));
  const bytes = ([at, count] = NOTHING) => new Uint8Array(buffer, start + at, count);
  const words = ([at, count] = NOTHING) => new Uint32Array(buffer, start + at, count);
  const floats = ([at, count] = NOTHING) => new Float32Array(buffer, start + at, count);
  const doubles = ([at, count] = NOTHING) => new Float64Array(buffer, start + at, count);
  switch (header.kind) {
    case "update": {
      const { poses, matrices } = header as { poses?: Transforms; matrices?: Transforms };
      const placed = {
        poseIds: words(poses?.ids),
        poses: floats(poses?.values),
        matrixIds: words(matrices?.ids),
        matrices: doubles(matrices?.values),
      };
      return { removed: [], nodes: [], ...header, ...placed };
    }
    case "controls":
      return { ...header, samples: header.samples.map(([id, span]: [number, Span]) => [id, doubles(span)]) };
    case "mesh":
      for (const name of ["position", "normal", "uv", "uv1"]) if (header[name]) header[name] = floats(header[name]);
      if (header.color) header.color = bytes(header.color);
      if (header.index) header.index = words(header.index);
      return header;
    default:
      return header;
  }
}
