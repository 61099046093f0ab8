// Materials and textures, shared by draws with equal properties. Materials are those of glTF: metallic-roughness, or unlit.

import {
  ClampToEdgeWrapping,
  type Color,
  DoubleSide,
  Euler,
  FrontSide,
  ImageLoader,
  LineBasicMaterial,
  MeshBasicMaterial,
  type MeshBasicMaterialParameters,
  MeshLambertMaterial,
  MeshStandardMaterial,
  MirroredRepeatWrapping,
  NearestFilter,
  NoColorSpace,
  PointsMaterial,
  RepeatWrapping,
  Source,
  SRGBColorSpace,
  Texture,
  type Material as ThreeMaterial,
  type Wrapping,
} from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import type { Material, TextureUse } from "./protocol";
import { BEFORE_SURFACE, patch, SIZE_IN_METRES } from "./shaders";

const WRAP: Record<number, Wrapping> = {
  10497: RepeatWrapping,
  33071: ClampToEdgeWrapping,
  33648: MirroredRepeatWrapping,
};
/** Number of materials up to which unused ones without textures are kept, so that geometry that returns does not compile its shader again. */
const MAX_MATERIALS = 64;
/** Milliseconds before a failed download of a texture is repeated. */
const RETRY_MS = 2000;

/** Placeholder until a texture is downloaded; three.js draws black without an image. */
function placeholderImage(): HTMLCanvasElement {
  const canvas = Object.assign(document.createElement("canvas"), { width: 1, height: 1 });
  const context = canvas.getContext("2d");
  if (context) {
    context.fillStyle = "white";
    context.fillRect(0, 0, 1, 1);
  }
  return canvas;
}

/** Return true if a material has highlights. Others get a cheaper shader. */
function isShiny(material: Material): boolean {
  return (material.roughness ?? 1) < 1 || isMetallic(material);
}

/**
 * Return true if a material reflects the environment map. Without it, metals would be black. Other materials do without,
 * because it takes four fifths of the time to draw without a GPU.
 */
function isMetallic({ metallic = 0 }: Material): boolean {
  return metallic > 0;
}

/** Size of all points. `sent`: as published. */
export interface PointSize {
  unit: "sent" | "pixels" | "metres";
  size: number;
}

interface SharedMaterial {
  material: ThreeMaterial;
  users: number;
  textures: Texture[];
}

export class Materials {
  private readonly shared = new Map<string, SharedMaterial>();
  private readonly keys = new WeakMap<ThreeMaterial, string>();
  private readonly textures = new Map<string, Texture>();
  private readonly loader = new ImageLoader();
  private readonly downloaded = new WeakSet<Texture>();
  /** Textures by those that they replaced. */
  private readonly replacements = new WeakMap<Texture, Texture>();
  /** Texture that new ones show until they are downloaded: that of the draw that they replace. */
  replaced: Texture | null = null;
  /** True if a material was released since the last `disposeUnused`. */
  private released = false;
  private wireframe = false;
  private pointSize: PointSize = { unit: "sent", size: 0 };

  /** @param environmentMap returns the environment map that metals reflect, Y-up */
  constructor(
    private readonly redraw: () => void,
    private readonly environmentMap: () => Texture | null,
  ) {}

  /** True if a material in use is translucent. */
  get areTranslucent(): boolean {
    return [...this.shared.values()].some(({ material, users }) => users > 0 && material.transparent);
  }

  /** Return the key of a batch: all properties but the colour. */
  key(material: Material, vertexColors: boolean): string {
    const { color: _, ...rest } = material;
    return JSON.stringify(rest) + (vertexColors ? "v" : "");
  }

  /** Return a white material for a batch, coloured per instance. Must be released with `release`, like all others. */
  opaque(material: Material, vertexColors: boolean): ThreeMaterial {
    return this.acquire(`opaque ${this.key(material, vertexColors)}`, () => this.surface(material, vertexColors));
  }

  /** Return a material for a single draw, with its own colour and opacity. */
  translucent(material: Material, vertexColors: boolean, opacity: number): ThreeMaterial {
    return this.acquire(`translucent ${JSON.stringify(material)}${vertexColors} ${opacity}`, () => {
      return this.colored(this.surface(material, vertexColors), material, opacity, true);
    });
  }

  line(material: Material, vertexColors: boolean, opacity: number): ThreeMaterial {
    return this.acquire(`line ${JSON.stringify(material)}${vertexColors} ${opacity}`, () => {
      return this.colored(patch(new LineBasicMaterial({ vertexColors }), BEFORE_SURFACE), material, opacity);
    });
  }

  /** Return a material for lines of more than one pixel, which are drawn as LineSegments2. */
  wideLine(material: Material, vertexColors: boolean, opacity: number): LineMaterial {
    return this.acquire(`wide line ${JSON.stringify(material)}${vertexColors} ${opacity}`, () => {
      const threeMaterial = patch(new LineMaterial({ vertexColors, linewidth: material.lineWidth ?? 1 }), BEFORE_SURFACE);
      return this.colored(threeMaterial, material, opacity);
    }) as LineMaterial;
  }

  points(material: Material, vertexColors: boolean, opacity: number): ThreeMaterial {
    return this.acquire(`points ${JSON.stringify(material)}${vertexColors} ${opacity}`, () => {
      const threeMaterial = patch(new PointsMaterial({ vertexColors, sizeAttenuation: false }));
      threeMaterial.userData.size = material.pointSize ?? 1;
      this.sizePoints(threeMaterial);
      return this.colored(threeMaterial, material, opacity);
    });
  }

  /** Release a use of a material. */
  release(material: ThreeMaterial): void {
    const shared = this.shared.get(this.keys.get(material) ?? "");
    if (shared) shared.users -= 1;
    this.released = true;
  }

  /**
   * Dispose of textures that no draw uses. Called after an image is drawn: a material that replaces another one has taken over
   * its shader by then.
   */
  disposeUnused(): void {
    if (!this.released) return;
    this.released = false;
    const used = new Set<Texture>();
    for (const [key, { material, users, textures }] of this.shared)
      if (users > 0) for (const texture of textures) used.add(texture);
      else if (textures.length || this.shared.size > MAX_MATERIALS) {
        material.dispose();
        this.shared.delete(key);
      }
    for (const [key, texture] of this.textures)
      if (!used.has(texture)) {
        texture.dispose();
        this.textures.delete(key);
      }
  }

  /** Drop all textures: another gateway uses other ids. */
  forgetTextures(): void {
    for (const texture of this.textures.values()) texture.dispose();
    this.textures.clear();
    for (const { material } of this.shared.values()) material.dispose();
    this.shared.clear();
  }

  /** Use a new environment map. */
  renewEnvironment(): void {
    for (const { material } of this.shared.values())
      if (material instanceof MeshStandardMaterial && material.envMap) material.envMap = this.environmentMap();
  }

  setWireframe(on: boolean): void {
    this.wireframe = on;
    for (const { material } of this.shared.values()) if ("wireframe" in material) material.wireframe = on;
    this.redraw();
  }

  setPointSize(size: PointSize): void {
    this.pointSize = size;
    for (const { material } of this.shared.values()) if (material instanceof PointsMaterial) this.sizePoints(material);
    this.redraw();
  }

  private sizePoints(material: PointsMaterial): void {
    const { unit, size } = this.pointSize;
    material.size = unit === "sent" ? (material.userData.size as number) : size;
    material.defines = unit === "metres" ? { [SIZE_IN_METRES]: "" } : {};
    material.needsUpdate = true;
  }

  /** Set the colour of a draw and, if its node or its colour is translucent, the opacity. Return the three.js material. */
  private colored<M extends ThreeMaterial & { color: Color }>(threeMaterial: M, material: Material, nodeOpacity: number, blended = false): M {
    const [r, g, b, alpha] = material.color;
    threeMaterial.color.setRGB(r, g, b, SRGBColorSpace);
    const opacity = alpha * nodeOpacity;
    if (blended || opacity < 1) {
      threeMaterial.transparent = true;
      threeMaterial.depthWrite = false;
      threeMaterial.opacity = opacity;
    }
    return threeMaterial;
  }

  private surface(material: Material, vertexColors: boolean): MeshStandardMaterial | MeshLambertMaterial | MeshBasicMaterial {
    const parameters: MeshBasicMaterialParameters = {
      vertexColors,
      side: material.doubleSided ? DoubleSide : FrontSide,
      wireframe: this.wireframe,
      map: this.texture(material.texture, SRGBColorSpace),
    };
    if (material.alpha === "mask") parameters.alphaTest = material.cutoff ?? 0.5;
    if (material.unlit) return patch(new MeshBasicMaterial(parameters));
    const threeMaterial = isShiny(material) ? this.shiny(material, parameters) : new MeshLambertMaterial(parameters);
    if (material.emissive) threeMaterial.emissive.setRGB(...material.emissive, SRGBColorSpace);
    threeMaterial.emissiveMap = this.texture(material.emissiveTexture, SRGBColorSpace);
    threeMaterial.emissiveIntensity = material.emissiveStrength ?? 1;
    threeMaterial.normalMap = this.texture(material.normalTexture, NoColorSpace);
    // Without tangents, three.js' bitangent points to the image's bottom, because (0, 0) is its top-left corner.
    const scale = material.normalScale ?? 1;
    threeMaterial.normalScale.set(scale, -scale);
    threeMaterial.aoMap = this.texture(material.occlusionTexture, NoColorSpace);
    threeMaterial.aoMapIntensity = material.occlusionStrength ?? 1;
    return patch(threeMaterial);
  }

  private shiny(material: Material, parameters: MeshBasicMaterialParameters): MeshStandardMaterial {
    const map = this.texture(material.metallicRoughnessTexture, NoColorSpace);
    return new MeshStandardMaterial({
      ...parameters,
      metalness: material.metallic ?? 0,
      metalnessMap: map,
      roughness: material.roughness ?? 1,
      roughnessMap: map,
      envMap: isMetallic(material) ? this.environmentMap() : null,
      envMapIntensity: 0.3,
      envMapRotation: new Euler(Math.PI / 2, 0, 0),
    });
  }

  private texture(use: TextureUse | undefined, colorSpace: typeof SRGBColorSpace | typeof NoColorSpace): Texture | null {
    if (!use) return null;
    const key = JSON.stringify(use) + colorSpace;
    let threeTexture = this.textures.get(key);
    if (!threeTexture) {
      threeTexture = this.load(key, `view/image/${use.image}`);
      threeTexture.colorSpace = colorSpace;
      threeTexture.flipY = false; // glTF: (0, 0) is the top-left corner
      threeTexture.wrapS = WRAP[use.wrap[0]] ?? RepeatWrapping;
      threeTexture.wrapT = WRAP[use.wrap[1]] ?? RepeatWrapping;
      threeTexture.anisotropy = 4;
      if (!use.linear) threeTexture.magFilter = NearestFilter;
      threeTexture.channel = use.set ?? 0;
      if (use.transform) {
        threeTexture.matrixAutoUpdate = false;
        threeTexture.matrix.set(...use.transform, 0, 0, 1);
      }
      this.textures.set(key, threeTexture);
    }
    return threeTexture;
  }

  private load(key: string, url: string, tries = 3): Texture {
    const texture = new Texture();
    texture.source = this.replaced?.source ?? new Source(placeholderImage());
    texture.needsUpdate = true;
    if (this.replaced) this.replacements.set(this.replaced, texture);
    const download = () =>
      this.loader.load(
        url,
        (image) => {
          const source = new Source(image);
          // Replacements that are not yet downloaded show the image, too.
          for (let each: Texture | undefined = texture; each && !this.downloaded.has(each); each = this.replacements.get(each)) {
            each.dispose(); // the image has another size than the last one
            each.source = source;
            each.needsUpdate = true;
          }
          this.downloaded.add(texture);
          this.redraw();
        },
        undefined,
        () => (tries -= 1) > 0 && setTimeout(() => this.textures.get(key) === texture && download(), RETRY_MS),
      );
    download();
    return texture;
  }

  private acquire(key: string, make: () => ThreeMaterial): ThreeMaterial {
    let shared = this.shared.get(key);
    if (!shared) {
      const material = make();
      const { envMap: _, ...own } = material as ThreeMaterial & { envMap?: Texture };
      shared = { material, users: 0, textures: Object.values(own).filter((value: unknown) => value instanceof Texture) };
      this.shared.set(key, shared);
      this.keys.set(shared.material, key);
    }
    shared.users += 1;
    return shared.material;
  }
}
