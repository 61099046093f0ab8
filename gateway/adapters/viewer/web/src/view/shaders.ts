// Changes of three.js' shaders by onBeforeCompile: colours of vertices and instances in sRGB, depth offsets, points in metres.

import type { Material } from "three";

/** Depth offset behind a surface, for lines that lie in it: half a percent of the distance, less than a line's width. */
export const BEHIND_SURFACE = 2e-5;
/** Depth offset in front of a surface, for lines that must stay visible in it. */
export const BEFORE_SURFACE = -1e-5;

/** Conversion of colours from sRGB: on the GPU, since a cloud has millions of points. */
const LINEAR_COLORS = `#include <color_vertex>
#if defined( USE_COLOR ) || defined( USE_COLOR_ALPHA ) || defined( USE_INSTANCING_COLOR )
	vColor.rgb = mix( pow( vColor.rgb * 0.9478672986 + 0.0521327014, vec3( 2.4 ) ), vColor.rgb * 0.0773993808, vec3( lessThanEqual( vColor.rgb, vec3( 0.04045 ) ) ) );
#endif`;

/** Define of a material of points whose size is in metres; three.js' own attenuation leaves out the field of view. */
export const SIZE_IN_METRES = "SIZE_IN_METRES";
const POINT_SIZE = `gl_PointSize = size;
#ifdef ${SIZE_IN_METRES}
	gl_PointSize *= scale * projectionMatrix[1][1] / gl_Position.w;
#endif`;

/**
 * Make a material read colours per vertex and instance as sRGB, and add an offset to its depth, in units of the depth
 * range (-1..1). Return the material.
 */
export function patch<M extends Material>(material: M, depth = 0): M {
  const offset = `\n\tgl_Position.z += ${depth.toFixed(8)} * gl_Position.w;`;
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader.replace("#include <color_vertex>", LINEAR_COLORS).replace("gl_PointSize = size;", POINT_SIZE);
    if (depth === 0) return;
    // The first string is in the shaders of most materials, the second one in that of LineMaterial.
    for (const projected of ["#include <project_vertex>", "gl_Position = clip;"])
      shader.vertexShader = shader.vertexShader.replace(projected, projected + offset);
  };
  material.customProgramCacheKey = () => `scenegate ${depth}`;
  return material;
}
