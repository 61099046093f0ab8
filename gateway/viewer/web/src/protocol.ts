// Messages about the scene and the page. A test compares these types with the gateway's messages
// (tests/viewer/test_protocol_types.py).

export interface TextureUse {
  image: number;
  wrap: [number, number];
  linear: boolean;
  /** Texture coordinate set of the mesh; default 0. */
  set?: number;
  /** a, b, c, d, e, f: u' = a u + b v + c, v' = d u + e v + f */
  transform?: [number, number, number, number, number, number];
}

/** Colours are in sRGB. */
export interface Material {
  color: [number, number, number, number];
  alpha?: "mask" | "blend";
  /** Alpha cutoff of a mask; default 0.5. */
  cutoff?: number;
  metallic?: number;
  roughness?: number;
  emissive?: [number, number, number];
  doubleSided?: boolean;
  unlit?: boolean;
  pointSize?: number;
  lineWidth?: number;
  texture?: TextureUse;
  /** Green: roughness, blue: metallic. */
  metallicRoughnessTexture?: TextureUse;
  normalTexture?: TextureUse;
  /** Default 1. */
  normalScale?: number;
  /** Red: occlusion. */
  occlusionTexture?: TextureUse;
  /** Default 1. */
  occlusionStrength?: number;
  emissiveTexture?: TextureUse;
  /** Default 1. */
  emissiveStrength?: number;
}

export interface Draw {
  mesh: number;
  material: Material;
  /** Column-major transform from mesh to node; default identity, null: not finite, so not drawn. */
  matrix?: number[] | null;
}

export interface Part {
  kind: string;
  draws: Draw[];
  points?: number;
  /** Number of columns of each channel of a point cloud, by name. */
  channels?: Record<string, number>;
  source?: string;
  /** True: the part is turned about its origin so that it is always seen from the front. */
  facesCamera?: boolean;
}

export interface NodeUpdate {
  id: number;
  parent?: number;
  name?: string | number;
  visible?: boolean;
  opacity?: number;
  parts?: Part[] | null;
}

export interface SceneUpdate {
  kind: "update";
  from: number;
  revision: number;
  /** Time from which the scene was so, nanoseconds since the epoch. */
  timestamp?: number;
  removed: number[];
  nodes: NodeUpdate[];
  poseIds: Uint32Array;
  /** x, y, z, qw, qx, qy, qz of each node in poseIds */
  poses: Float32Array;
  matrixIds: Uint32Array;
  /** 4x4 column-major transform of each node in matrixIds */
  matrices: Float64Array;
}

export interface MeshPayload {
  kind: "mesh";
  id: number;
  topology: 1 | 2 | 3;
  position: Float32Array;
  /** Bounds of the positions: minimum and maximum. */
  box?: [Vector, Vector];
  normal?: Float32Array;
  color?: Uint8Array;
  uv?: Float32Array;
  uv1?: Float32Array;
  index?: Uint32Array;
}

export interface Forget {
  kind: "forget";
  meshes: number[];
}

export interface InterfaceState {
  state: string;
  title: string;
  documentation: string;
  /** Reason of a failure. */
  problem?: string;
  warnings?: string[];
}

export interface Status {
  kind: "status";
  interfaces?: Record<string, InterfaceState>;
  facts?: { name: string; value: string | number; warn?: boolean }[];
  /** Number of render requests so far. */
  renders?: number;
}

/** The stereo camera in the scene. */
export interface PlacedRig {
  kind: "rig";
  /** Column-major pose of the left camera's optical frame. */
  pose: number[];
  width: number;
  height: number;
  fx: number;
  fy: number;
  cx: number;
  cy: number;
  baseline: number;
}

/** Pose null: the stereo camera is not in this scene. */
export type Rig = PlacedRig | { kind: "rig"; pose: null };

export type Path = (string | number)[];
export type Vector = [number, number, number];

/** View settings that clients have set. Null: the page's own setting. */
export interface PageSettings {
  kind: "page";
  /** Red, green, blue: sRGB from 0 to 1. */
  background: Vector | null;
  grid: boolean | null;
  home: { eye: Vector; target: Vector; up: Vector } | null;
  /** Paths at and below which clients receive clicks on geometry. */
  clickable: Path[];
}

/** Message to the gateway about a click on geometry. */
export interface Click {
  node: number;
  /** Point in the world, metres. */
  point: Vector;
  button: "left" | "middle" | "right";
}
