// Materials, shared by draws with equal properties. They are those of glTF: metallic-roughness, or unlit.

import * as THREE from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import type { PageMaterial, TextureUse } from "../protocol";
import type { Lights } from "./lights";
import { BEFORE_SURFACE, patch, SIZE_IN_METRES } from "./shaders";
import { Textures } from "./textures";

/** Number of materials up to which unused ones without textures are kept, so that geometry that returns does not compile its shader again. */
const MAX_MATERIALS = 64;

/**
 * Sort of a draw. `opaque`: of a batch, white, coloured per instance; the others have their own colour and opacity.
 * `wideLine`: lines of more than one pixel, which are drawn as LineSegments2.
 */
export type MaterialKind = "opaque" | "translucent" | "line" | "wideLine" | "points";

/** Size of all points. `sent`: as published. */
export type PointSize = { unit: "sent" | "pixels" | "metres"; size: number };

export class Materials {
  readonly textures = new Textures(() => this.redraw());
  /** Materials by their properties. `userData`: number of `users`, `textures`, and `size` of points. */
  private readonly shared = new Map<string, THREE.Material>();
  /** True if a material was released since the last `disposeUnused`. */
  private released = false;
  private wireframe = false;
  private pointSize: PointSize = { unit: "sent", size: 0 };

  constructor(
    private readonly lights: Lights,
    private readonly redraw: () => void,
  ) {}

  get areTranslucent(): boolean {
    return [...this.shared.values()].some(({ userData, transparent }) => userData.users > 0 && transparent);
  }

  /** Return the key of a batch: all properties but the colour. */
  key(material: PageMaterial, vertexColors: boolean): string {
    const { color: _, ...rest } = material;
    return JSON.stringify(rest) + (vertexColors ? "v" : "");
  }

  /** Return a material for a draw, whose node has an opacity. Must be released with `release`. */
  acquire(kind: MaterialKind, material: PageMaterial, vertexColors: boolean, opacity = 1): THREE.Material {
    const key = `${kind} ${this.key(material, vertexColors)} ${kind === "opaque" ? "" : [material.color, opacity]}`;
    let shared = this.shared.get(key);
    if (!shared) {
      const made = this.create(kind, material, vertexColors);
      if (kind !== "opaque") color(made, material, opacity, kind === "translucent");
      const { envMap: _, ...own } = made as THREE.Material & { envMap?: THREE.Texture };
      Object.assign(made.userData, { users: 0, textures: Object.values(own).filter((value: unknown) => value instanceof THREE.Texture) });
      this.shared.set(key, (shared = made));
    }
    shared.userData.users += 1;
    return shared;
  }

  release(material: THREE.Material): void {
    material.userData.users -= 1;
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
    for (const [key, material] of this.shared) {
      const { users, textures } = material.userData as { users: number; textures: THREE.Texture[] };
      if (users > 0) for (const texture of textures) used.add(texture);
      else if (textures.length || this.shared.size > MAX_MATERIALS) {
        material.dispose();
        this.shared.delete(key);
      }
    }
    this.textures.disposeAllBut(used);
  }

  forget(): void {
    this.textures.disposeAllBut(new Set());
    for (const material of this.shared.values()) material.dispose();
    this.shared.clear();
  }

  /** Follow the environment of the lights. */
  renewEnvironment(): void {
    for (const material of this.shared.values())
      if (material instanceof THREE.MeshStandardMaterial && material.envMap)
        Object.assign(material, { envMap: this.lights.environmentMap, envMapIntensity: this.lights.change.ambient });
  }

  setWireframe(on: boolean): void {
    this.wireframe = on;
    for (const material of this.shared.values()) if ("wireframe" in material) material.wireframe = on;
    this.redraw();
  }

  setPointSize(size: PointSize): void {
    this.pointSize = size;
    for (const material of this.shared.values()) if (material instanceof THREE.PointsMaterial) this.sizePoints(material);
    this.redraw();
  }

  private sizePoints(material: THREE.PointsMaterial): THREE.PointsMaterial {
    const { unit, size } = this.pointSize;
    material.size = unit === "sent" ? (material.userData.size as number) : size;
    material.defines = unit === "metres" ? { [SIZE_IN_METRES]: "" } : {};
    material.needsUpdate = true;
    return material;
  }

  private create(kind: MaterialKind, material: PageMaterial, vertexColors: boolean): THREE.Material & { color: THREE.Color } {
    const points = { vertexColors, sizeAttenuation: false, userData: { size: material.pointSize ?? 1 } };
    if (kind === "line") return patch(new THREE.LineBasicMaterial({ vertexColors }), BEFORE_SURFACE);
    if (kind === "wideLine") return patch(new LineMaterial({ vertexColors, linewidth: material.lineWidth ?? 1 }), BEFORE_SURFACE);
    if (kind === "points") return this.sizePoints(patch(new THREE.PointsMaterial(points)));
    return patch(this.surface(material, vertexColors));
  }

  /**
   * Return the material of triangles. Metals reflect the environment map: without it, they would be black. Others do without,
   * because it takes four fifths of the time to draw without a GPU; without highlights, they have a cheaper shader.
   */
  private surface(material: PageMaterial, vertexColors: boolean): THREE.MeshStandardMaterial | THREE.MeshLambertMaterial | THREE.MeshBasicMaterial {
    const { metallic = 0, roughness = 1, normalScale = 1, alpha, cutoff = 0.5 } = material;
    const colors = (use?: TextureUse) => this.textures.get(use, THREE.SRGBColorSpace);
    const values = (use?: TextureUse) => this.textures.get(use, THREE.NoColorSpace);
    const basic = {
      vertexColors,
      side: material.doubleSided ? THREE.DoubleSide : THREE.FrontSide,
      wireframe: this.wireframe,
      map: colors(material.texture),
      alphaTest: alpha === "mask" ? cutoff : 0,
    };
    if (material.unlit) return new THREE.MeshBasicMaterial(basic);
    const lit = {
      ...basic,
      emissive: new THREE.Color().setRGB(...(material.emissive ?? [0, 0, 0]), THREE.SRGBColorSpace),
      emissiveMap: colors(material.emissiveTexture),
      emissiveIntensity: material.emissiveStrength ?? 1,
      normalMap: values(material.normalTexture),
      // Without tangents, three.js' bitangent points to the image's bottom, because (0, 0) is its top-left corner.
      normalScale: new THREE.Vector2(normalScale, -normalScale),
      aoMap: values(material.occlusionTexture),
      aoMapIntensity: material.occlusionStrength ?? 1,
    };
    if (metallic <= 0 && roughness >= 1) return new THREE.MeshLambertMaterial(lit);
    const map = values(material.metallicRoughnessTexture);
    return new THREE.MeshStandardMaterial({
      ...lit,
      metalness: metallic,
      metalnessMap: map,
      roughness,
      roughnessMap: map,
      envMap: metallic > 0 ? this.lights.environmentMap : null,
      envMapIntensity: this.lights.change.ambient,
      envMapRotation: new THREE.Euler(Math.PI / 2, 0, 0),
    });
  }
}

/** Set the colour of a draw and, if its node or its colour is translucent, the opacity. */
function color(made: THREE.Material & { color: THREE.Color }, material: PageMaterial, nodeOpacity: number, blended: boolean): void {
  const [r, g, b, alpha] = material.color;
  made.color.setRGB(r, g, b, THREE.SRGBColorSpace);
  const opacity = alpha * nodeOpacity;
  if (blended || opacity < 1) Object.assign(made, { transparent: true, depthWrite: false, opacity });
}
