// Lights of the page's own renderer: a sky, a lamp that can cast shadows, and a weak headlight, so that no side is black.
// Metals also reflect an environment map.

import { Box3, type Camera, DirectionalLight, HemisphereLight, Object3D, PMREMGenerator, type Texture, Vector3, type WebGLRenderer } from "three";
import { RoomEnvironment } from "three/addons/environments/RoomEnvironment.js";

/** Direction to the lamp: left of and behind the camera of the home view, as in the look "studio" of the gateway's images. */
const LAMP_DIRECTION = new Vector3(-0.35, -0.55, 1).normalize();
const SHADOW_TEXELS = 2048;

export class Lights {
  readonly object = new Object3D();
  private readonly sky = new HemisphereLight(0xffffff, 0xa8a29a, 1.0);
  private readonly lamp = new DirectionalLight(0xfffaf2, 1.5);
  private readonly headlight = new DirectionalLight(0xffffff, 0.8);
  private environment: Texture | null = null;

  constructor(private readonly renderer: WebGLRenderer | null) {
    this.sky.position.set(0, 0, 1);
    this.lamp.position.copy(LAMP_DIRECTION);
    this.lamp.shadow.mapSize.setScalar(SHADOW_TEXELS);
    this.lamp.shadow.radius = 2.5;
    this.object.add(this.sky, this.lamp, this.lamp.target, this.headlight, this.headlight.target);
  }

  /** Environment map of a room, Y-up. The first use creates it, which takes seconds without a GPU. */
  get environmentMap(): Texture | null {
    if (!this.environment && this.renderer) {
      const generator = new PMREMGenerator(this.renderer);
      const room = new RoomEnvironment();
      this.environment = generator.fromScene(room, 0.04).texture;
      room.dispose();
      generator.dispose();
    }
    return this.environment;
  }

  /** Make the environment map anew at its next use, after the graphics device has lost it. */
  forgetEnvironment(): void {
    this.environment?.dispose();
    this.environment = null;
  }

  placeHeadlight(camera: Camera, target: Vector3): void {
    this.headlight.position.copy(camera.position);
    this.headlight.target.position.copy(target);
  }

  /** Cast shadows within boxes; null: cast none. */
  castShadows(boxes: Box3[] | null): void {
    this.lamp.castShadow = boxes !== null;
    if (!boxes) return;
    const box = boxes.reduce((all, each) => all.union(each), new Box3());
    if (box.isEmpty()) return;
    const centre = box.getCenter(new Vector3());
    const radius = Math.max(1e-3, box.getSize(new Vector3()).length() / 2);
    const { camera } = this.lamp.shadow;
    this.lamp.target.position.copy(centre);
    this.lamp.position.copy(centre).addScaledVector(LAMP_DIRECTION, 2 * radius);
    Object.assign(camera, { left: -radius, right: radius, bottom: -radius, top: radius, near: 0.5 * radius, far: 4 * radius });
    camera.updateProjectionMatrix();
    this.lamp.shadow.normalBias = (3 * radius) / SHADOW_TEXELS;
  }
}
