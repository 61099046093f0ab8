// What stands for the connection to the gateway in a file with a recording: it feeds the page the recorded messages.

import type { Message } from "../connection";
import { inflate, Player, type Recording, readRecording } from "./recording";

export class RecordedConnection {
  private player: Player | undefined;

  /** @param onMessage, onState as those of `Connection` */
  constructor(
    private readonly onMessage: (message: Message) => void,
    private readonly onState: (state: "open" | "closed", reason: string) => void,
  ) {
    const element = document.getElementById("recording")!;
    const start = (recording: Recording) => this.start(recording);
    const fail = (error: unknown) => this.onState("closed", `The recording in this file cannot be read: ${error}`);
    inflate(element.textContent ?? "")
      .then(readRecording)
      .then(start)
      .catch(fail);
    element.textContent = ""; // its memory is free when it is decoded
  }

  private start({ messages, steps }: Recording): void {
    this.onState("open", "");
    messages.forEach(this.onMessage);
    this.player = new Player(steps, this.onMessage);
    this.player.show(steps[0]!.time);
  }

  /** Nobody waits for it. */
  acknowledge(): void {}

  /** Nobody receives it: clicks and changes of controls are of live pages. */
  report(): void {}
}
