// Depth offsets for lines that lie in a surface, where rounding of the depth would decide.

import type { Material } from "three";

/** Offset behind a surface: half a percent of the distance, less than the width of a line. */
export const BEHIND = 2e-5;
/** Offset in front of a surface. */
export const BEFORE = -1e-5;

/** Make a line material add an offset to its depth, in units of the depth range (-1..1). Return the material. */
export function shiftDepth<M extends Material>(material: M, by: number): M {
  const text = by.toFixed(8);
  material.onBeforeCompile = (shader) => {
    // The second one is in the shader of LineMaterial.
    for (const projected of ["#include <project_vertex>", "gl_Position = clip;"])
      shader.vertexShader = shader.vertexShader.replace(projected, `${projected}\n\tgl_Position.z += ${text} * gl_Position.w;`);
  };
  material.customProgramCacheKey = () => `depth ${text}`;
  return material;
}
