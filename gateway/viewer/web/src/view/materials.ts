// Materials, shared by draws with equal properties. They are those of glTF: metallic-roughness, or unlit.

import * as THREE from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import type { Material } from "../protocol";
import type { PointSize } from "../tools/pointsize";
import { BEFORE_SURFACE, patch, SIZE_IN_METRES } from "./shaders";
import { Textures } from "./textures";

/** Number of materials up to which unused ones without textures are kept, so that geometry that returns does not compile its shader again. */
const MAX_MATERIALS = 64;

/**
 * Sort of a draw. `opaque`: of a batch, white, coloured per instance; the others have their own colour and opacity.
 * `wideLine`: lines of more than one pixel, which are drawn as LineSegments2.
 */
export type MaterialKind = "opaque" | "translucent" | "line" | "wideLine" | "points";

interface SharedMaterial {
  material: THREE.Material;
  users: number;
  textures: THREE.Texture[];
}

export class Materials {
  readonly textures: Textures;
  private readonly shared = new Map<string, SharedMaterial>();
  private readonly keys = new WeakMap<THREE.Material, string>();
  /** True if a material was released since the last `disposeUnused`. */
  private released = false;
  private wireframe = false;
  private pointSize: PointSize = { unit: "sent", size: 0 };

  /** @param environmentMap returns the environment map that metals reflect, Y-up */
  constructor(
    private readonly redraw: () => void,
    private readonly environmentMap: () => THREE.Texture | null,
  ) {
    this.textures = new Textures(redraw);
  }

  /** True if a material in use is translucent. */
  get areTranslucent(): boolean {
    return [...this.shared.values()].some(({ material, users }) => users > 0 && material.transparent);
  }

  /** Return the key of a batch: all properties but the colour. */
  key(material: Material, vertexColors: boolean): string {
    const { color: _, ...rest } = material;
    return JSON.stringify(rest) + (vertexColors ? "v" : "");
  }

  /** Return a material for a draw, whose node has an opacity. Must be released with `release`. */
  acquire(kind: MaterialKind, material: Material, vertexColors: boolean, opacity = 1): THREE.Material {
    const key = `${kind} ${this.key(material, vertexColors)} ${kind === "opaque" ? "" : [material.color, opacity]}`;
    let shared = this.shared.get(key);
    if (!shared) {
      const made = this.create(kind, material, vertexColors);
      if (kind !== "opaque") color(made, material, opacity, kind === "translucent");
      const { envMap: _, ...own } = made as THREE.Material & { envMap?: THREE.Texture };
      shared = { material: made, users: 0, textures: Object.values(own).filter((value: unknown) => value instanceof THREE.Texture) };
      this.shared.set(key, shared);
      this.keys.set(made, key);
    }
    shared.users += 1;
    return shared.material;
  }

  /** Release a use of a material. */
  release(material: THREE.Material): void {
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
    const used = new Set<THREE.Texture>();
    for (const [key, { material, users, textures }] of this.shared)
      if (users > 0) for (const texture of textures) used.add(texture);
      else if (textures.length || this.shared.size > MAX_MATERIALS) {
        material.dispose();
        this.shared.delete(key);
      }
    this.textures.disposeAllBut(used);
  }

  /** Drop everything: another gateway uses other ids. */
  forget(): void {
    this.textures.disposeAllBut(new Set());
    for (const { material } of this.shared.values()) material.dispose();
    this.shared.clear();
  }

  /** Use a new environment map. */
  renewEnvironment(): void {
    for (const { material } of this.shared.values())
      if (material instanceof THREE.MeshStandardMaterial && material.envMap) material.envMap = this.environmentMap();
  }

  setWireframe(on: boolean): void {
    this.wireframe = on;
    for (const { material } of this.shared.values()) if ("wireframe" in material) material.wireframe = on;
    this.redraw();
  }

  setPointSize(size: PointSize): void {
    this.pointSize = size;
    for (const { material } of this.shared.values()) if (material instanceof THREE.PointsMaterial) this.sizePoints(material);
    this.redraw();
  }

  private sizePoints(material: THREE.PointsMaterial): THREE.PointsMaterial {
    const { unit, size } = this.pointSize;
    material.size = unit === "sent" ? (material.userData.size as number) : size;
    material.defines = unit === "metres" ? { [SIZE_IN_METRES]: "" } : {};
    material.needsUpdate = true;
    return material;
  }

  private create(kind: MaterialKind, material: Material, vertexColors: boolean): THREE.Material & { color: THREE.Color } {
    switch (kind) {
      case "line":
        return patch(new THREE.LineBasicMaterial({ vertexColors }), BEFORE_SURFACE);
      case "wideLine":
        return patch(new LineMaterial({ vertexColors, linewidth: material.lineWidth ?? 1 }), BEFORE_SURFACE);
      case "points":
        return this.sizePoints(
          patch(new THREE.PointsMaterial({ vertexColors, sizeAttenuation: false, userData: { size: material.pointSize ?? 1 } })),
        );
      default:
        return patch(this.surface(material, vertexColors));
    }
  }

  private surface(material: Material, vertexColors: boolean): THREE.MeshStandardMaterial | THREE.MeshLambertMaterial | THREE.MeshBasicMaterial {
    const { textures, wireframe } = this;
    const side = material.doubleSided ? THREE.DoubleSide : THREE.FrontSide;
    const parameters: THREE.MeshBasicMaterialParameters = {
      vertexColors,
      side,
      wireframe,
      map: textures.get(material.texture, THREE.SRGBColorSpace),
    };
    if (material.alpha === "mask") parameters.alphaTest = material.cutoff ?? 0.5;
    if (material.unlit) return new THREE.MeshBasicMaterial(parameters);
    const { metallic = 0, roughness = 1 } = material;
    // Without highlights, a cheaper shader.
    const made = metallic > 0 || roughness < 1 ? this.shiny(material, parameters) : new THREE.MeshLambertMaterial(parameters);
    if (material.emissive) made.emissive.setRGB(...material.emissive, THREE.SRGBColorSpace);
    made.emissiveMap = textures.get(material.emissiveTexture, THREE.SRGBColorSpace);
    made.emissiveIntensity = material.emissiveStrength ?? 1;
    made.normalMap = textures.get(material.normalTexture, THREE.NoColorSpace);
    // Without tangents, three.js' bitangent points to the image's bottom, because (0, 0) is its top-left corner.
    const scale = material.normalScale ?? 1;
    made.normalScale.set(scale, -scale);
    made.aoMap = textures.get(material.occlusionTexture, THREE.NoColorSpace);
    made.aoMapIntensity = material.occlusionStrength ?? 1;
    return made;
  }

  /**
   * Return a material with highlights. Metals reflect the environment map: without it, they would be black. Others do without,
   * because it takes four fifths of the time to draw without a GPU.
   */
  private shiny(
    { metallic = 0, roughness = 1, metallicRoughnessTexture }: Material,
    parameters: THREE.MeshBasicMaterialParameters,
  ): THREE.MeshStandardMaterial {
    const map = this.textures.get(metallicRoughnessTexture, THREE.NoColorSpace);
    return new THREE.MeshStandardMaterial({
      ...parameters,
      metalness: metallic,
      metalnessMap: map,
      roughness,
      roughnessMap: map,
      envMap: metallic > 0 ? this.environmentMap() : null,
      envMapIntensity: 0.3,
      envMapRotation: new THREE.Euler(Math.PI / 2, 0, 0),
    });
  }
}

/** Set the colour of a draw and, if its node or its colour is translucent, the opacity. */
function color(made: THREE.Material & { color: THREE.Color }, material: Material, nodeOpacity: number, blended: boolean): void {
  const [r, g, b, alpha] = material.color;
  made.color.setRGB(r, g, b, THREE.SRGBColorSpace);
  const opacity = alpha * nodeOpacity;
  if (blended || opacity < 1) Object.assign(made, { transparent: true, depthWrite: false, opacity });
}
