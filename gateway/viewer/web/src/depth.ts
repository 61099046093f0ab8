// Lines that lie in a surface: who is in front is said, not left to the rounding of depth.

import type { Material } from "three";

/** Behind a surface at the same place; half a percent of the distance, which is less than a line is wide. */
export const BEHIND = 2e-5;
/** Before it: half of that. */
export const BEFORE = -1e-5;

/** Moves what a line material draws in depth, by a part of the depth's range (-1..1). Returns the material. */
export function shiftDepth<M extends Material>(material: M, by: number): M {
  const text = by.toFixed(8);
  material.onBeforeCompile = (shader) => {
    const projected = "#include <project_vertex>";
    shader.vertexShader = shader.vertexShader.replace(projected, `${projected}\n\tgl_Position.z += ${text} * gl_Position.w;`);
  };
  material.customProgramCacheKey = () => `depth ${text}`;
  return material;
}
