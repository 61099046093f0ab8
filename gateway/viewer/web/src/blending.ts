// An image of linear colours in between, in which translucent surfaces are blended as light, as in the gateway's images.

import { SRGBColorSpace, type WebGLRenderer, WebGLRenderTarget } from "three";
import { OutputPass } from "three/addons/postprocessing/OutputPass.js";

export class LinearImage {
  private readonly image = new WebGLRenderTarget(1, 1, { colorSpace: SRGBColorSpace, samples: 4 });
  private readonly output = new OutputPass();

  constructor(private readonly renderer: WebGLRenderer) {
    this.output.renderToScreen = true;
  }

  /** Draw into the image by `render`, then the image into the view. Colours and depths are kept for the next call. */
  draw(render: () => void): void {
    const { width, height } = this.renderer.domElement;
    if (this.image.width !== width || this.image.height !== height) this.image.setSize(width, height);
    this.renderer.setRenderTarget(this.image);
    render();
    this.output.render(this.renderer, this.image, this.image, 0, false);
  }

  /** Free what the next image makes again. */
  dispose(): void {
    this.image.dispose();
    this.output.dispose();
  }
}
