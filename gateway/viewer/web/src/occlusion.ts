// Ambient occlusion: a post-processing pass of three.js (GTAO).

import { HalfFloatType, type OrthographicCamera, type PerspectiveCamera, type Scene, type WebGLRenderer, WebGLRenderTarget } from "three";
import { EffectComposer } from "three/addons/postprocessing/EffectComposer.js";
import { GTAOPass } from "three/addons/postprocessing/GTAOPass.js";
import { OutputPass } from "three/addons/postprocessing/OutputPass.js";
import { RenderPass } from "three/addons/postprocessing/RenderPass.js";

/** Radius of the effect as a fraction of half the view's height. */
const RADIUS_FRACTION = 0.12;

export class AmbientOcclusion {
  private readonly composer: EffectComposer;
  private readonly pass: GTAOPass;

  constructor(renderer: WebGLRenderer, scene: Scene, camera: PerspectiveCamera | OrthographicCamera) {
    this.composer = new EffectComposer(renderer, new WebGLRenderTarget(1, 1, { type: HalfFloatType, samples: 4 }));
    this.pass = new GTAOPass(scene, camera);
    for (const each of [new RenderPass(scene, camera), this.pass, new OutputPass()]) this.composer.addPass(each);
  }

  setSize(width: number, height: number, pixelRatio: number): void {
    this.composer.setPixelRatio(pixelRatio);
    this.composer.setSize(width, height);
  }

  /** Draw the scene. `halfHeight` is half the view's height at the target, metres. */
  render(halfHeight: number): void {
    const radius = RADIUS_FRACTION * halfHeight;
    this.pass.updateGtaoMaterial({ radius, thickness: radius });
    this.composer.render();
  }

  dispose(): void {
    this.pass.dispose();
    this.composer.dispose();
  }
}
