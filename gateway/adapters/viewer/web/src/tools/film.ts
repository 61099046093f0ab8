// A film of the view, recorded by the browser.

import { signal } from "@preact/signals";
import { saveBlob } from "../files";

/** Maximum number of frames per second. Only changed frames are in the film. */
const RATE = 30;
const BITS_PER_SECOND = 12_000_000;

export class Film {
  readonly isRecording = signal(false);
  private recorder: MediaRecorder | null = null;

  constructor(private readonly canvas: HTMLElement) {}

  get isPossible(): boolean {
    return this.canvas instanceof HTMLCanvasElement && "MediaRecorder" in window;
  }

  /** Start a film, or end it and download it as WebM. */
  toggle = (): void => {
    this.recorder?.stop();
    if (this.recorder || !(this.canvas instanceof HTMLCanvasElement && this.isPossible)) return;
    const pieces: Blob[] = [];
    const recorder = new MediaRecorder(this.canvas.captureStream(RATE), { mimeType: "video/webm", videoBitsPerSecond: BITS_PER_SECOND });
    recorder.ondataavailable = ({ data }) => pieces.push(data);
    recorder.onstop = () => {
      for (const track of recorder.stream.getTracks()) track.stop();
      this.recorder = null;
      this.isRecording.value = false;
      saveBlob(new Blob(pieces, { type: "video/webm" }), "scenegate.webm");
    };
    recorder.start(1000);
    this.recorder = recorder;
    this.isRecording.value = true;
  };
}
