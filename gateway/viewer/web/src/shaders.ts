// Two additions to three.js' shaders, by its hook for that: colours per vertex or instance in sRGB, and depth offsets.

import type { Material } from "three";

/** Depth offset behind a surface, for lines that lie in it: half a percent of the distance, less than a line's width. */
export const BEHIND = 2e-5;
/** Depth offset in front of a surface. */
export const BEFORE = -1e-5;

/** Colours come in sRGB, as bytes: the conversion of millions of points is the GPU's. */
const LINEAR_COLORS = `#include <color_vertex>
#if defined( USE_COLOR ) || defined( USE_COLOR_ALPHA ) || defined( USE_INSTANCING_COLOR )
	vColor.rgb = mix( pow( vColor.rgb * 0.9478672986 + 0.0521327014, vec3( 2.4 ) ), vColor.rgb * 0.0773993808, vec3( lessThanEqual( vColor.rgb, vec3( 0.04045 ) ) ) );
#endif`;

/**
 * Make a material read colours per vertex and instance as sRGB, and add an offset to its depth, in units of the depth
 * range (-1..1). Return the material.
 */
export function patch<M extends Material>(material: M, depth = 0): M {
  const offset = `\n\tgl_Position.z += ${depth.toFixed(8)} * gl_Position.w;`;
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader.replace("#include <color_vertex>", LINEAR_COLORS);
    if (depth === 0) return;
    // The second one is in the shader of LineMaterial.
    for (const projected of ["#include <project_vertex>", "gl_Position = clip;"])
      shader.vertexShader = shader.vertexShader.replace(projected, projected + offset);
  };
  material.customProgramCacheKey = () => `scenegate ${depth}`;
  return material;
}
