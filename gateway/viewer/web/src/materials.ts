// Materials and textures, shared by what looks alike. Colours are shown as our rasterizer's "phong" look shows them:
// no conversion between colour spaces, light from the camera.

import {
  ClampToEdgeWrapping,
  DoubleSide,
  FrontSide,
  LineBasicMaterial,
  MeshBasicMaterial,
  MeshLambertMaterial,
  MirroredRepeatWrapping,
  NearestFilter,
  PointsMaterial,
  RepeatWrapping,
  TextureLoader,
  type Material as ThreeMaterial,
  type MeshLambertMaterialParameters,
  type Texture,
  type Wrapping,
} from "three";
import type { Material } from "./protocol";

const WRAP: Record<number, Wrapping> = {
  10497: RepeatWrapping,
  33071: ClampToEdgeWrapping,
  33648: MirroredRepeatWrapping,
};

export class Materials {
  private readonly made = new Map<string, ThreeMaterial>();
  private readonly textures = new Map<string, Texture>();
  private readonly loader = new TextureLoader();
  wireframe = false;
  /** Pixels; 0 takes what the scene says. */
  pointSize = 0;

  constructor(private readonly redraw: () => void) {}

  /** What all draws of one batch share: everything but the colour. */
  key(material: Material, vertexColors: boolean): string {
    const { color: _, ...rest } = material;
    return JSON.stringify(rest) + (vertexColors ? "v" : "");
  }

  /** For batches: white, coloured per instance. */
  opaque(material: Material, vertexColors: boolean): ThreeMaterial {
    return this.get(`opaque ${this.key(material, vertexColors)}`, () => this.surface(material, vertexColors));
  }

  /** For single draws: with its own colour and opacity. */
  translucent(material: Material, vertexColors: boolean, opacity: number): ThreeMaterial {
    const key = `translucent ${JSON.stringify(material)}${vertexColors} ${opacity}`;
    return this.get(key, () => {
      const made = this.surface(material, vertexColors);
      made.color.setRGB(material.color[0], material.color[1], material.color[2]);
      made.transparent = true;
      made.depthWrite = false;
      made.opacity = material.color[3] * opacity;
      return made;
    });
  }

  line(material: Material, vertexColors: boolean, opacity: number): ThreeMaterial {
    return this.get(`line ${JSON.stringify(material)}${vertexColors} ${opacity}`, () => {
      const made = new LineBasicMaterial({ vertexColors });
      made.color.setRGB(material.color[0], material.color[1], material.color[2]);
      this.fade(made, material.color[3] * opacity);
      return made;
    });
  }

  points(material: Material, vertexColors: boolean, opacity: number): PointsMaterial {
    return this.get(`points ${JSON.stringify(material)}${vertexColors} ${opacity}`, () => {
      const made = new PointsMaterial({ vertexColors, sizeAttenuation: false });
      made.userData.size = material.pointSize ?? 1;
      made.size = this.pointSize || made.userData.size;
      made.color.setRGB(material.color[0], material.color[1], material.color[2]);
      this.fade(made, material.color[3] * opacity);
      return made;
    }) as PointsMaterial;
  }

  setWireframe(on: boolean): void {
    this.wireframe = on;
    for (const made of this.made.values())
      if (made instanceof MeshLambertMaterial || made instanceof MeshBasicMaterial) made.wireframe = on;
    this.redraw();
  }

  setPointSize(pixels: number): void {
    this.pointSize = pixels;
    for (const made of this.made.values())
      if (made instanceof PointsMaterial) made.size = pixels || (made.userData.size as number);
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
    if (material.alpha === "mask") parameters.alphaTest = 0.5;
    if (material.unlit) return new MeshBasicMaterial(parameters);
    const made = new MeshLambertMaterial(parameters);
    if (material.emissive) made.emissive.setRGB(...material.emissive);
    return made;
  }

  private texture(texture: NonNullable<Material["texture"]>): Texture {
    const key = JSON.stringify(texture);
    let made = this.textures.get(key);
    if (!made) {
      made = this.loader.load(`/view/image/${texture.image}`, this.redraw);
      made.flipY = false; // glTF: (0, 0) is the top-left corner
      made.wrapS = WRAP[texture.wrap[0]] ?? RepeatWrapping;
      made.wrapT = WRAP[texture.wrap[1]] ?? RepeatWrapping;
      if (!texture.linear) made.magFilter = NearestFilter;
      this.textures.set(key, made);
    }
    return made;
  }

  private get<T extends ThreeMaterial>(key: string, make: () => T): T {
    let made = this.made.get(key);
    if (!made) this.made.set(key, (made = make()));
    return made as T;
  }
}
