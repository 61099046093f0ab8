// Drawing of the page's scene by WebGL: into the view, or first into an image, for translucent surfaces or ambient occlusion.

import { HalfFloatType, type OrthographicCamera, type PerspectiveCamera, type Scene, SRGBColorSpace, WebGLRenderer, WebGLRenderTarget } from "three";
import { EffectComposer } from "three/addons/postprocessing/EffectComposer.js";
import { GTAOPass } from "three/addons/postprocessing/GTAOPass.js";
import { OutputPass } from "three/addons/postprocessing/OutputPass.js";
import { RenderPass } from "three/addons/postprocessing/RenderPass.js";
import { CLOUD_LAYER } from "./cloudprogress";

type Camera = PerspectiveCamera | OrthographicCamera;
/** Radius of ambient occlusion as a fraction of half the view's height. */
const RADIUS_FRACTION = 0.12;

/** Return a renderer, or null in a browser without WebGL 2. */
export function newRenderer(): WebGLRenderer | null {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
  if (!context) return null;
  const renderer = new WebGLRenderer({ canvas, context });
  renderer.shadowMap.enabled = true;
  renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  return renderer;
}

export class Rendering {
  /** Image of linear colours, in which translucent surfaces are blended as light, as in the gateway's images. */
  private readonly linearImage = new WebGLRenderTarget(1, 1, { colorSpace: SRGBColorSpace, samples: 4 });
  private readonly output = new OutputPass();
  /** Passes of ambient occlusion; null: off. */
  private occlusion: { composer: EffectComposer; pass: GTAOPass } | null = null;

  constructor(
    private readonly renderer: WebGLRenderer,
    private readonly scene: Scene,
  ) {
    this.output.renderToScreen = true;
  }

  get hasOcclusion(): boolean {
    return this.occlusion !== null;
  }

  setOcclusion(on: boolean, camera: Camera): void {
    this.occlusion?.pass.dispose();
    this.occlusion?.composer.dispose();
    this.occlusion = null;
    if (!on) return;
    const composer = new EffectComposer(this.renderer, new WebGLRenderTarget(1, 1, { type: HalfFloatType, samples: 4 }));
    const pass = new GTAOPass(this.scene, camera);
    for (const each of [new RenderPass(this.scene, camera), pass, new OutputPass()]) composer.addPass(each);
    this.occlusion = { composer, pass };
  }

  setSize(width: number, height: number): void {
    this.renderer.setSize(width, height);
    this.occlusion?.composer.setPixelRatio(this.renderer.getPixelRatio());
    this.occlusion?.composer.setSize(width, height);
  }

  /** Draw the scene. `halfHeight` is half the view's height at the target, metres. */
  draw(camera: Camera, halfHeight: number, translucent: boolean) {
    if (!this.occlusion) return this.drawPlain(camera, translucent);
    const radius = RADIUS_FRACTION * halfHeight;
    this.occlusion.pass.updateGtaoMaterial({ radius, thickness: radius });
    this.occlusion.composer.render();
  }

  /** Add chunks of point clouds to the image. Its colours and depths are kept. */
  refine(camera: Camera, translucent: boolean): void {
    const { renderer, scene } = this;
    const { mask } = camera.layers;
    const { background } = scene;
    camera.layers.set(CLOUD_LAYER);
    scene.background = null; // three.js clears the image to a background, even without autoClear
    renderer.autoClear = renderer.shadowMap.autoUpdate = false;
    this.drawPlain(camera, translucent);
    renderer.autoClear = renderer.shadowMap.autoUpdate = true;
    scene.background = background;
    camera.layers.mask = mask;
  }

  private drawPlain(camera: Camera, translucent: boolean): void {
    const { renderer, linearImage } = this;
    if (translucent) {
      const { width, height } = renderer.domElement;
      if (linearImage.width !== width || linearImage.height !== height) linearImage.setSize(width, height);
      renderer.setRenderTarget(linearImage);
    } else for (const unused of [linearImage, this.output]) unused.dispose(); // the next translucent image makes them again
    renderer.render(this.scene, camera);
    if (translucent) this.output.render(renderer, linearImage, linearImage, 0, false);
  }
}
