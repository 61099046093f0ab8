// A WebSocket that reconnects by itself. The gateway sends the next update only after the acknowledgement "k", the next
// values of controls only after "c".

import type { ControlChange, ControlsMessage, Received } from "./programs/controlmessages";
import type { Click, Forget, MeshPayload, PageSettings, Rig, SceneUpdate, Status } from "./protocol";
import type { TimeCommand, TimeState } from "./tools/timeline";

export type Message = SceneUpdate | MeshPayload | Forget | Status | Rig | PageSettings | ControlsMessage | Received | TimeState;

const MAGIC = 0x31564753;
/** [offset in bytes, number of values] */
type Span = [number, number];
const NOTHING: Span = [0, 0];
type Transforms = { ids: Span; values: Span };

/** Parse a frame of gateway/viewer/frames.py: a JSON header that refers to arrays in the body. The typed arrays share the message's memory. */
function parse(buffer: ArrayBuffer): Message {
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

const FIRST_DELAY = 250;
const MAX_DELAY = 4000;

export class Connection {
  private socket: WebSocket | undefined;
  private delay = FIRST_DELAY;

  /**
   * @param onMessage called with every message
   * @param onState called when the connection opens or closes, with the gateway's reason if it gave one; after "open" the
   *   gateway sends the whole scene
   */
  constructor(
    private readonly onMessage: (message: Message) => void,
    private readonly onState: (state: "open" | "closed", reason: string) => void,
  ) {
    this.open();
  }

  /** Acknowledge the last update or the last values of controls. */
  acknowledge(text: "k" | "c"): void {
    this.delay = FIRST_DELAY;
    this.send(text);
  }

  /** Report a click that a client wants, a change of a control, a command of the time bar, or meshes that were dropped. */
  report(message: Click | ControlChange | TimeCommand | { forgot: number[] }): void {
    this.send(JSON.stringify(message));
  }

  private send(text: string): void {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(text);
  }

  private open(): void {
    const socket = new WebSocket(new URL("view/ws", location.href.replace(/^http/, "ws")));
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.onState("open", "");
    socket.onmessage = (event: MessageEvent<ArrayBuffer>) => {
      try {
        this.onMessage(parse(event.data));
      } catch (error) {
        // After an invalid message the page's scene is out of date: reconnect.
        console.error("scenegate:", error);
        socket.close();
      }
    };
    socket.onclose = ({ reason }) => {
      this.onState("closed", reason);
      setTimeout(() => this.open(), this.delay);
      this.delay = Math.min(this.delay * 2, MAX_DELAY);
    };
    this.socket = socket;
  }
}
