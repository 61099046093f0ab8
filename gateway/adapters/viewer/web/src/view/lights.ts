// The light of the gateway's images (renderers/light_rig.py): its lights with shadows, its environment, exposure and tone curve.

import {
  Box3,
  DataTexture,
  DirectionalLight,
  EquirectangularReflectionMapping,
  FloatType,
  type Light,
  LightProbe,
  LinearFilter,
  Object3D,
  PMREMGenerator,
  PointLight,
  SpotLight,
  type Texture,
  Vector3,
  type WebGLRenderer,
} from "three";
import type { PageLight, PageLighting } from "../protocol";
import { grading } from "./shaders";

const SHADOW_TEXELS = 2048;
const TONES: PageLighting["tone"][] = ["neutral", "aces", "none"];

function create({ type, color, position, direction, range, innerCone, outerCone }: PageLight): Light {
  const light =
    type === "directional"
      ? new DirectionalLight()
      : type === "point"
        ? new PointLight(0xffffff, 1, range)
        : new SpotLight(0xffffff, 1, range, outerCone, 1 - innerCone / outerCone);
  light.color.setRGB(...color);
  if (type !== "directional") light.position.set(...position);
  if ("target" in light) light.target.position.copy(light.position).add(new Vector3(...direction));
  return light;
}

export class Lights {
  readonly object = new Object3D();
  private readonly ambient = new LightProbe();
  private lighting: PageLighting | null = null;
  /** Lights that can cast shadows, with the directions in which they shine. */
  private readonly casting = new Map<DirectionalLight, Vector3>();
  private environment: Texture | null = null;

  constructor(private readonly renderer: WebGLRenderer | null) {
    this.object.add(this.ambient);
  }

  set(lighting: PageLighting): void {
    this.lighting = lighting;
    this.ambient.sh.fromArray(lighting.ambient);
    grading.toneMappingExposure.value = lighting.exposure;
    grading.tone.value = TONES.indexOf(lighting.tone);
    this.object.clear();
    this.casting.clear();
    this.object.add(this.ambient);
    for (const each of lighting.lights) {
      const light = create(each);
      this.object.add(light);
      if ("target" in light) this.object.add(light.target as Object3D);
      if (!(light instanceof DirectionalLight && each.castsShadow)) continue;
      light.shadow.mapSize.setScalar(SHADOW_TEXELS);
      light.shadow.radius = 3;
      this.casting.set(light, new Vector3(...each.direction));
    }
    this.forgetEnvironment();
  }

  /** Environment that metals reflect, Y-up. The first use filters it, which takes seconds without a GPU. */
  get environmentMap(): Texture | null {
    if (!this.environment && this.renderer && this.lighting) {
      const { environment, size } = this.lighting;
      const [height, width] = size;
      const texels = new Float32Array(4 * width * height);
      for (let i = 0; i < width * height; i++) texels.set(environment.subarray(3 * i, 3 * i + 3), 4 * i);
      const image = new DataTexture(texels, width, height, undefined, FloatType, EquirectangularReflectionMapping);
      Object.assign(image, { flipY: true, minFilter: LinearFilter, magFilter: LinearFilter, needsUpdate: true });
      const generator = new PMREMGenerator(this.renderer);
      this.environment = generator.fromEquirectangular(image).texture;
      image.dispose();
      generator.dispose();
    }
    return this.environment;
  }

  /** Make the environment map anew at its next use, after the graphics device has lost it. */
  forgetEnvironment(): void {
    this.environment?.dispose();
    this.environment = null;
  }

  /** Cast shadows within boxes; null: cast none. */
  castShadows(boxes: Box3[] | null): void {
    const box = (boxes ?? []).reduce((all, each) => all.union(each), new Box3());
    const centre = box.getCenter(new Vector3());
    const radius = Math.max(1e-3, box.getSize(new Vector3()).length() / 2);
    for (const [light, direction] of this.casting) {
      light.castShadow = !box.isEmpty();
      if (box.isEmpty()) continue;
      light.target.position.copy(centre);
      light.position.copy(centre).addScaledVector(direction, -2 * radius);
      Object.assign(light.shadow.camera, { left: -radius, right: radius, bottom: -radius, top: radius, near: 0.5 * radius, far: 4 * radius });
      light.shadow.camera.updateProjectionMatrix();
      light.shadow.normalBias = (6 * radius) / SHADOW_TEXELS;
    }
  }
}
