// A WebSocket that reconnects by itself. The gateway sends the next update only after the acknowledgement "k", the next
// values of controls only after "c".

import { type Message, parse } from "./frames";
import type { ControlChange } from "./programs/controlmessages";
import type { Click } from "./protocol";

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

  /** Report a click that a client wants, or a change of a control. */
  report(message: Click | ControlChange): void {
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
