// Objects of draws that are not in a batch: lines, points, and translucent triangles.

import { type BufferGeometry, LineSegments, type Material, Mesh, type Object3D, Points, Quaternion, Vector3 } from "three";
import type { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import type { TreeNode } from "../model";
import type { Draw, MeshPayload } from "../protocol";
import { colorPoints } from "./clouds";
import type { Geometries } from "./geometries";
import type { MaterialKind } from "./materials";
import type { Stage } from "./stage";

/** Object of a draw. The first chunk of a point cloud has the others as children. */
export type SingleObject = Mesh | LineSegments | LineSegments2 | Points;
/** Number of chunks of a cloud that picking searches: half a million points take 10 ms. */
const PICKED_CHUNKS = 8;

export class SingleObjects {
  constructor(
    private readonly geometries: Geometries,
    private readonly stage: Stage,
  ) {}

  make(node: TreeNode, draw: Draw, payload: MeshPayload, facesCamera: boolean): SingleObject {
    const object = this.create(node, draw, payload);
    if (object instanceof Mesh) object.receiveShadow = true;
    object.matrixAutoUpdate = false;
    object.userData.node = node;
    if (facesCamera) object.onBeforeRender = (_renderer, _scene, camera) => turnToCamera(object, camera);
    return object;
  }

  private create(node: TreeNode, draw: Draw, payload: MeshPayload): SingleObject {
    const { geometries, stage } = this;
    const material = (kind: MaterialKind) => stage.materials.acquire(kind, draw.material, payload.color !== undefined, node.combinedOpacity);
    if (payload.topology === 3) return new Mesh(geometries.whole(payload), material("translucent"));
    if (payload.topology === 1) return this.points(node, draw, payload, material("points"));
    if ((draw.material.lineWidth ?? 1) > 1) return new LineSegments2(geometries.wideLine(payload), material("wideLine") as LineMaterial);
    return new LineSegments(geometries.whole(payload), material("line"));
  }

  private points(node: TreeNode, draw: Draw, payload: MeshPayload, material: Material): Points {
    const { geometries, stage } = this;
    const objects = geometries.chunks(payload).map((geometry) => new Points(geometry, material));
    const [first, ...others] = objects as [Points, ...Points[]];
    objects.forEach((object, number) => {
      if (others.length) stage.clouds.add(object, number);
      if (number >= PICKED_CHUNKS) object.raycast = () => {};
      object.userData.node = node;
    });
    if (others.length) first.add(...others);
    if (node.cloud) void colorPoints(node, draw, objects, payload, stage.materials).then(stage.redraw);
    return first;
  }

  remove(object: SingleObject): void {
    object.removeFromParent();
    this.stage.materials.release(object.material as Material);
    const objects = [object, ...object.children];
    for (const each of objects) (each.userData.ownGeometry as BufferGeometry | undefined)?.dispose();
    if (objects.length > 1) this.stage.clouds.remove(new Set(objects));
  }
}

/** Turn an object about its origin so that its x and y axes are those of the camera. Position and scale stay. */
function turnToCamera(object: Object3D, camera: Object3D): void {
  const position = new Vector3().setFromMatrixPosition(object.matrixWorld);
  const scale = new Vector3().setFromMatrixScale(object.matrixWorld);
  object.matrixWorld.compose(position, camera.getWorldQuaternion(new Quaternion()), scale);
}
