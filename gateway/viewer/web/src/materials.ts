// Materials and textures, shared by draws with equal properties. Shading follows the rasterizer's "plain" look: no
// conversion between colour spaces, light from the camera.

import {
  ClampToEdgeWrapping,
  DoubleSide,
  FrontSide,
  ImageLoader,
  LineBasicMaterial,
  MeshBasicMaterial,
  MeshLambertMaterial,
  MirroredRepeatWrapping,
  NearestFilter,
  PointsMaterial,
  RepeatWrapping,
  Texture,
  type Material as ThreeMaterial,
  type MeshLambertMaterialParameters,
  type Wrapping,
} from "three";
import { BEFORE, shiftDepth } from "./depth";
import { h } from "./dom";
import type { Material } from "./protocol";

const WRAP: Record<number, Wrapping> = {
  10497: RepeatWrapping,
  33071: ClampToEdgeWrapping,
  33648: MirroredRepeatWrapping,
};
/** Maximum number of unused materials kept, so that replaced geometry does not compile its shader again. */
const KEPT = 64;
/** Milliseconds before a failed download of a texture is repeated. */
const RETRY = 2000;

/** Placeholder until a texture is downloaded; three.js draws black without an image. */
function blank(): HTMLCanvasElement {
  const canvas = h("canvas", { width: 1, height: 1 });
  const context = canvas.getContext("2d");
  if (context) {
    context.fillStyle = "white";
    context.fillRect(0, 0, 1, 1);
  }
  return canvas;
}

interface Shared {
  material: ThreeMaterial;
  users: number;
}

export class Materials {
  private readonly made = new Map<string, Shared>();
  private readonly keys = new WeakMap<ThreeMaterial, string>();
  private readonly textures = new Map<string, Texture>();
  private readonly loader = new ImageLoader();
  private wireframe = false;
  /** Pixels; 0 is the scene's own size. */
  private pointSize = 0;

  constructor(private readonly redraw: () => void) {}

  /** Return the key of a batch: all properties but the colour. */
  key(material: Material, vertexColors: boolean): string {
    const { color: _, ...rest } = material;
    return JSON.stringify(rest) + (vertexColors ? "v" : "");
  }

  /** Return a white material for a batch, coloured per instance. Must be released with `release`, like all others. */
  opaque(material: Material, vertexColors: boolean): ThreeMaterial {
    return this.take(`opaque ${this.key(material, vertexColors)}`, () => this.surface(material, vertexColors));
  }

  /** Return a material for a single draw, with its own colour and opacity. */
  translucent(material: Material, vertexColors: boolean, opacity: number): ThreeMaterial {
    return this.take(`translucent ${JSON.stringify(material)}${vertexColors} ${opacity}`, () => {
      const made = this.surface(material, vertexColors);
      made.color.setRGB(material.color[0], material.color[1], material.color[2]);
      made.transparent = true;
      made.depthWrite = false;
      made.opacity = material.color[3] * opacity;
      return made;
    });
  }

  line(material: Material, vertexColors: boolean, opacity: number): ThreeMaterial {
    return this.take(`line ${JSON.stringify(material)}${vertexColors} ${opacity}`, () => {
      const made = shiftDepth(new LineBasicMaterial({ vertexColors }), BEFORE);
      made.color.setRGB(material.color[0], material.color[1], material.color[2]);
      this.fade(made, material.color[3] * opacity);
      return made;
    });
  }

  points(material: Material, vertexColors: boolean, opacity: number): ThreeMaterial {
    return this.take(`points ${JSON.stringify(material)}${vertexColors} ${opacity}`, () => {
      const made = new PointsMaterial({ vertexColors, sizeAttenuation: false });
      made.userData.size = (material.pointSize ?? 1) * devicePixelRatio;
      made.size = this.pointSize * devicePixelRatio || (made.userData.size as number);
      made.color.setRGB(material.color[0], material.color[1], material.color[2]);
      this.fade(made, material.color[3] * opacity);
      return made;
    });
  }

  /** Release a use of a material. */
  release(material: ThreeMaterial): void {
    const shared = this.made.get(this.keys.get(material) ?? "");
    if (shared) shared.users -= 1;
    if (this.made.size <= KEPT) return;
    for (const [key, { material: unused, users }] of this.made) {
      if (users > 0) continue;
      unused.dispose();
      this.made.delete(key);
      if (this.made.size <= KEPT) return;
    }
  }

  /** Drop all textures: another gateway uses other ids. */
  forgetTextures(): void {
    for (const texture of this.textures.values()) texture.dispose();
    this.textures.clear();
    for (const { material } of this.made.values()) material.dispose();
    this.made.clear();
  }

  setWireframe(on: boolean): void {
    this.wireframe = on;
    for (const { material } of this.made.values())
      if (material instanceof MeshLambertMaterial || material instanceof MeshBasicMaterial) material.wireframe = on;
    this.redraw();
  }

  setPointSize(pixels: number): void {
    this.pointSize = pixels;
    for (const { material } of this.made.values())
      if (material instanceof PointsMaterial) material.size = pixels * devicePixelRatio || (material.userData.size as number);
    this.redraw();
  }

  private fade(made: ThreeMaterial, opacity: number): void {
    if (opacity >= 1) return;
    made.transparent = true;
    made.depthWrite = false;
    made.opacity = opacity;
  }

  private surface(material: Material, vertexColors: boolean): MeshLambertMaterial | MeshBasicMaterial {
    const parameters: MeshLambertMaterialParameters = {
      vertexColors,
      side: material.doubleSided ? DoubleSide : FrontSide,
      wireframe: this.wireframe,
      map: material.texture ? this.texture(material.texture) : null,
    };
    if (material.alpha === "mask") parameters.alphaTest = material.cutoff ?? 0.5;
    if (material.unlit) return new MeshBasicMaterial(parameters);
    const made = new MeshLambertMaterial(parameters);
    if (material.emissive) made.emissive.setRGB(...material.emissive);
    return made;
  }

  private texture(texture: NonNullable<Material["texture"]>): Texture {
    const key = JSON.stringify(texture);
    let made = this.textures.get(key);
    if (!made) {
      made = this.load(`/view/image/${texture.image}`);
      made.flipY = false; // glTF: (0, 0) is the top-left corner
      made.wrapS = WRAP[texture.wrap[0]] ?? RepeatWrapping;
      made.wrapT = WRAP[texture.wrap[1]] ?? RepeatWrapping;
      made.anisotropy = 4;
      if (!texture.linear) made.magFilter = NearestFilter;
      made.channel = texture.set ?? 0;
      if (texture.transform) {
        made.matrixAutoUpdate = false;
        made.matrix.set(...texture.transform, 0, 0, 1);
      }
      this.textures.set(key, made);
    }
    return made;
  }

  private load(url: string, tries = 3): Texture {
    const made = new Texture<HTMLCanvasElement | HTMLImageElement>(blank());
    made.needsUpdate = true;
    const ask = () =>
      this.loader.load(
        url,
        (image) => {
          made.dispose(); // the image has another size than the placeholder
          made.image = image;
          made.needsUpdate = true;
          this.redraw();
        },
        undefined,
        () => (tries -= 1) > 0 && setTimeout(ask, RETRY),
      );
    ask();
    return made;
  }

  private take(key: string, make: () => ThreeMaterial): ThreeMaterial {
    let shared = this.made.get(key);
    if (!shared) {
      shared = { material: make(), users: 0 };
      this.made.set(key, shared);
      this.keys.set(shared.material, key);
    }
    shared.users += 1;
    return shared.material;
  }
}
