// Textures, shared by materials, with the images of the gateway.

import * as THREE from "three";
import type { TextureUse } from "../protocol";
import { addressOf, imagePath } from "../resources";

const WRAP: Record<number, THREE.Wrapping> = { 10497: THREE.RepeatWrapping, 33071: THREE.ClampToEdgeWrapping, 33648: THREE.MirroredRepeatWrapping };
/** Milliseconds before a failed download is repeated. */
const RETRY_MS = 2000;
const MAX_TRIES = 3;

/** Return what a texture shows until it is downloaded; three.js draws black without an image. */
function placeholder(): THREE.TextureSource<HTMLCanvasElement> {
  const canvas = Object.assign(document.createElement("canvas"), { width: 1, height: 1 });
  const context = Object.assign(canvas.getContext("2d")!, { fillStyle: "white" });
  context.fillRect(0, 0, 1, 1);
  return new THREE.TextureSource(canvas);
}

export class Textures {
  private readonly byKey = new Map<string, THREE.Texture>();
  private readonly loader = new THREE.ImageLoader();
  private readonly downloaded = new WeakSet<THREE.Texture>();
  /** Textures by those that they replaced. */
  private readonly replacements = new WeakMap<THREE.Texture, THREE.Texture>();
  /** Texture that new ones show until they are downloaded: that of the draw that they replace. */
  replaced: THREE.Texture | null = null;

  constructor(private readonly redraw: () => void) {}

  get(use: TextureUse | undefined, colorSpace: typeof THREE.SRGBColorSpace | typeof THREE.NoColorSpace): THREE.Texture | null {
    if (!use) return null;
    const key = JSON.stringify(use) + colorSpace;
    let texture = this.byKey.get(key);
    if (texture) return texture;
    texture = new THREE.Texture();
    texture.source = this.replaced?.source ?? placeholder();
    texture.needsUpdate = true;
    texture.colorSpace = colorSpace;
    texture.flipY = false; // glTF: (0, 0) is the top-left corner
    texture.wrapS = WRAP[use.wrap[0]] ?? THREE.RepeatWrapping;
    texture.wrapT = WRAP[use.wrap[1]] ?? THREE.RepeatWrapping;
    texture.anisotropy = 4;
    if (!use.linear) texture.magFilter = THREE.NearestFilter;
    texture.channel = use.set ?? 0;
    if (use.transform) {
      texture.matrixAutoUpdate = false;
      texture.matrix.set(...use.transform, 0, 0, 1);
    }
    if (this.replaced) this.replacements.set(this.replaced, texture);
    this.byKey.set(key, texture);
    this.download(key, texture, addressOf(imagePath(use.image)), MAX_TRIES);
    return texture;
  }

  private download(key: string, texture: THREE.Texture, url: string, tries: number): void {
    const again = () => this.byKey.get(key) === texture && this.download(key, texture, url, tries - 1);
    const show = (image: HTMLImageElement) => {
      const source = new THREE.TextureSource(image);
      // Replacements that are not yet downloaded show the image, too.
      for (let each: THREE.Texture | undefined = texture; each && !this.downloaded.has(each); each = this.replacements.get(each)) {
        each.dispose(); // the image has another size than the last one
        each.source = source;
        each.needsUpdate = true;
      }
      this.downloaded.add(texture);
      this.redraw();
    };
    this.loader.load(url, show, undefined, () => tries > 1 && setTimeout(again, RETRY_MS));
  }

  disposeAllBut(used: ReadonlySet<THREE.Texture>): void {
    for (const [key, texture] of this.byKey)
      if (!used.has(texture)) {
        texture.dispose();
        this.byKey.delete(key);
      }
  }
}
