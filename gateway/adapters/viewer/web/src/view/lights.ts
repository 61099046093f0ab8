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
  MathUtils,
  Object3D,
  PMREMGenerator,
  PointLight,
  SpotLight,
  type Texture,
  Vector3,
  type WebGLRenderer,
} from "three";
import type { PageLight, PageLighting, Vector } from "../protocol";
import { grading } from "./shaders";

const { degToRad, radToDeg } = MathUtils;
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

/** Changes of the key light, the first directional one, and of the environment, as `renderers.light_rig.LightChange`. */
export interface LightChange {
  /** Direction from which the key light comes: degrees from +X, counter-clockwise seen from above; null: the rig's. */
  azimuth: number | null;
  /** Degrees above the horizon; null: the rig's. */
  elevation: number | null;
  /** Factor of the key light. */
  strength: number;
  /** Factor of the environment. */
  ambient: number;
}
export const NO_CHANGE: LightChange = { azimuth: null, elevation: null, strength: 1, ambient: 1 };

/** Direction from which a light comes, degrees. */
export type Angles = { azimuth: number; elevation: number };

/** Return the angles of a light that shines in a direction. */
export function anglesOf([x, y, z]: Vector): Angles {
  return { azimuth: radToDeg(Math.atan2(-y, -x)), elevation: radToDeg(Math.atan2(-z, Math.hypot(x, y))) };
}

/** Return the direction in which a light shines. */
export function directionFrom({ azimuth, elevation }: Angles): Vector3 {
  const [a, e] = [degToRad(azimuth), degToRad(elevation)];
  return new Vector3(Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)).negate();
}

export class Lights {
  readonly object = new Object3D();
  private readonly ambient = new LightProbe();
  private lighting: PageLighting | null = null;
  /** First directional light. */
  private key: { light: DirectionalLight; own: PageLight } | null = null;
  change: LightChange = NO_CHANGE;
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
    this.key = null;
    this.object.add(this.ambient);
    for (const each of lighting.lights) {
      const light = create(each);
      this.object.add(light);
      if ("target" in light) this.object.add(light.target as Object3D);
      if (light instanceof DirectionalLight) this.key ??= { light, own: each };
      if (!(light instanceof DirectionalLight && each.castsShadow)) continue;
      light.shadow.mapSize.setScalar(SHADOW_TEXELS);
      light.shadow.radius = 3;
      this.casting.set(light, new Vector3(...each.direction));
    }
    this.forgetEnvironment();
    this.adapt(this.change);
  }

  /** Direction of the key light as the gateway has it; null: there is none. */
  get ownAngles(): Angles | null {
    return this.key && anglesOf(this.key.own.direction);
  }

  /** Change the light. `castShadows` must follow. */
  adapt(change: LightChange): void {
    this.change = change;
    this.ambient.intensity = change.ambient;
    const { key, ownAngles } = this;
    if (!key || !ownAngles) return;
    key.light.intensity = change.strength;
    const { azimuth, elevation } = change;
    const direction = directionFrom({ azimuth: azimuth ?? ownAngles.azimuth, elevation: elevation ?? ownAngles.elevation });
    key.light.position.set(0, 0, 0);
    key.light.target.position.copy(direction);
    this.casting.get(key.light)?.copy(direction);
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
