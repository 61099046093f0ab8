// What stands for the connection to the gateway in a file with a recording: it feeds the page the recorded messages.

import type { Message, TimeCommand } from "../protocol";
import { Playback } from "./playback";
import { inflate, type Recording, readRecording } from "./recording";

const seconds = () => performance.now() / 1000;

export class RecordedConnection {
  private playback: Playback | undefined;

  /** @param onMessage, onState as those of `Connection` */
  constructor(
    private readonly onMessage: (message: Message) => void,
    private readonly onState: (state: "open" | "closed", reason: string) => void,
  ) {
    const element = document.getElementById("recording")!;
    const { view } = element.dataset;
    if (view && !location.hash) location.hash = view; // the camera of the page that made the file
    inflate(element.textContent ?? "")
      .then((buffer) => this.start(readRecording(buffer)))
      .catch((error) => this.onState("closed", `The recording in this file cannot be read: ${error}`));
    element.textContent = ""; // its memory is free when it is decoded
  }

  private start(recording: Recording): void {
    this.onState("open", "");
    recording.messages.forEach(this.onMessage);
    const playback = new Playback(recording, seconds(), this.onMessage);
    this.playback = playback;
    const loop = () => {
      playback.tick(seconds());
      requestAnimationFrame(loop);
    };
    requestAnimationFrame(loop);
  }

  /** Nothing waits for it. */
  acknowledge(): void {}

  /** Execute a command of the time bar. Nothing receives clicks and changes of controls. */
  report(message: object): void {
    if ("time" in message) this.playback?.execute(message as TimeCommand, seconds());
  }
}
