// A WebSocket that reconnects by itself. The gateway sends the next update only after the acknowledgement "k", the next
// values of controls only after "c".

import type { Click, ControlChange, Forgot, Message, TimeCommand } from "./protocol";

const MAGIC = 0x31564753;
/** Constructors of typed arrays by the fields of messages that refer to arrays in the body. */
const ARRAYS: Record<string, Record<string, new (buffer: ArrayBuffer, at: number, count: number) => ArrayBufferView>> = {
  mesh: { position: Float32Array, normal: Float32Array, uv: Float32Array, uv1: Float32Array, color: Uint8Array, index: Uint32Array },
  image: { data: Uint8Array },
  channel: { data: Uint8Array },
  poses: { ids: Uint32Array, values: Float32Array },
  light: { environment: Float32Array },
  matrices: { ids: Uint32Array, values: Float64Array },
};

/** Parse a frame of gateway/adapters/viewer/frames.py: a JSON header that refers to arrays in the body. The typed arrays share the message's memory. */
export function parse(buffer: ArrayBuffer): Message {
  const view = new DataView(buffer);
  if (buffer.byteLength < 8 || view.getUint32(0, true) !== MAGIC) throw new Error("not a view frame");
  const start = 8 + view.getUint32(4, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, start - 8)));
  for (const [name, fields] of Object.entries(ARRAYS)) {
    const holder = name === header.kind ? header : header[name];
    for (const [field, Values] of Object.entries(holder ? fields : {}))
      if (holder[field]) holder[field] = new Values(buffer, start + holder[field][0], holder[field][1]);
  }
  for (const sample of header.samples ?? []) sample[1] = new Float64Array(buffer, start + sample[1][0], sample[1][1]);
  return header;
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

  acknowledge(text: "k" | "c"): void {
    this.delay = FIRST_DELAY;
    this.send(text);
  }

  /** Report a click that a client wants, a change of a control, a command of the time bar, or meshes that were dropped. */
  report(message: Click | ControlChange | TimeCommand | Forgot): void {
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
