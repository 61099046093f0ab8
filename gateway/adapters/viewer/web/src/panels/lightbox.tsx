// Dialog with an image in full size.

import { useEffect, useRef } from "preact/hooks";
import { Button, Download } from "../widgets/controls";
import type { Panels } from "./panels";

export function Lightbox({ panels }: { panels: Panels }) {
  const dialog = useRef<HTMLDialogElement>(null);
  const { value: image } = panels.full;
  const close = () => panels.open(null);
  useEffect(() => (image ? dialog.current?.showModal() : dialog.current?.close()), [image]);
  return (
    <dialog ref={dialog} aria-label="Image" onClose={close} onClick={({ target, currentTarget }) => target === currentTarget && close()}>
      {image && (
        <>
          <header>
            <h2>{image.title}</h2>
            <Download icon="download" title="Save the image" download={image.fileName} url={image.source} />
            <Button icon="close" aria-label="Close" title="Close (Esc)" onClick={close} />
          </header>
          <img alt={image.title} src={image.source()} />
        </>
      )}
    </dialog>
  );
}
