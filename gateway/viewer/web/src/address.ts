// What follows `#` in the page's address: the camera. A link to it, and a page that is loaded again, show the same view.

/** Shortest time between two changes of the address, ms: browsers limit them. */
const PERIOD_MS = 500;

export class CameraAddress {
  private timer = 0;

  /** @param text returns what the address has to say; empty in the home view */
  constructor(private readonly text: () => string) {}

  /** Write the camera into the address soon. */
  write(): void {
    this.timer ||= setTimeout(() => {
      this.timer = 0;
      const hash = this.text() && `#${this.text()}`;
      if (hash !== location.hash) history.replaceState(null, "", location.pathname + location.search + hash);
    }, PERIOD_MS);
  }

  /** Call back with the text of the address, now and when a link is followed. */
  read(place: (text: string) => void): void {
    const read = () => place(location.hash.slice(1));
    addEventListener("hashchange", read);
    read();
  }
}
