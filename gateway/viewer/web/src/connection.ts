// One WebSocket that comes back by itself. The gateway sends the next update only after "k".

import { parse, type Message } from "./protocol";

const FIRST_WAIT = 250;
const LONGEST_WAIT = 4000;

export class Connection {
  private socket: WebSocket | undefined;
  private wait = FIRST_WAIT;

  /**
   * @param onMessage takes a message in
   * @param onState told whenever the connection comes or goes, with the gateway's reason where it gave one; after "open" it sends
   *   the whole scene anew
   */
  constructor(
    private readonly onMessage: (message: Message) => void,
    private readonly onState: (state: "open" | "closed", reason: string) => void,
  ) {
    this.open();
  }

  /** Says that the last update was taken in. */
  ready(): void {
    this.wait = FIRST_WAIT;
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send("k");
  }

  private open(): void {
    const scheme = location.protocol === "https:" ? "wss:" : "ws:";
    const socket = new WebSocket(`${scheme}//${location.host}/view/ws`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => this.onState("open", "");
    socket.onmessage = (event: MessageEvent<ArrayBuffer>) => {
      try {
        this.onMessage(parse(event.data));
      } catch (error) {
        // What cannot be taken in leaves the page behind the gateway: start over.
        console.error("scenegate:", error);
        socket.close();
      }
    };
    socket.onclose = ({ reason }) => {
      this.onState("closed", reason);
      setTimeout(() => this.open(), this.wait);
      this.wait = Math.min(this.wait * 2, LONGEST_WAIT);
    };
    this.socket = socket;
  }
}
