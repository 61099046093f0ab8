// Changes of three.js' shaders by onBeforeCompile: colours of vertices and instances in sRGB, depth offsets, points in metres.

import { type Material, MeshLambertMaterial, MeshStandardMaterial, ShaderChunk, type WebGLProgramParametersWithUniforms } from "three";

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

/** Exposure and tone curve of lit surfaces, for all shaders. `tone`: 0 neutral, 1 ACES, 2 none. */
export const grading = { toneMappingExposure: { value: 1 }, tone: { value: 0 } };

/** In place of `opaque_fragment`: the environment's highlight where there is no environment map, and the tone curve. */
const LIT = `
#if defined( USE_LIGHT_PROBES ) && ! defined( USE_ENVMAP )
	{
		vec3 toCamera = normalize( vViewPosition );
		#ifdef STANDARD
			float rough = roughnessFactor;
		#else
			float rough = 1.0;
		#endif
		vec3 toLight = normalize( mix( reflect( -toCamera, normal ), normal, rough * rough ) );
		// Karis, "Physically Based Shading on Mobile" (2014): the integral of the BRDF, for a reflectance of 0.04.
		vec4 r = rough * vec4( -1.0, -0.0275, -0.572, 0.022 ) + vec4( 1.0, 0.0425, 1.04, -0.04 );
		float a004 = min( r.x * r.x, exp2( -9.28 * saturate( dot( normal, toCamera ) ) ) ) * r.x + r.y;
		vec2 integral = vec2( -1.04, 1.04 ) * a004 + r.zw;
		vec3 diffuse = diffuseColor.rgb * getLightProbeIrradiance( lightProbe, normal );
		outgoingLight += ( 0.04 * integral.x + integral.y ) * ( getLightProbeIrradiance( lightProbe, toLight ) - diffuse ) * RECIPROCAL_PI;
	}
#endif
#include <opaque_fragment>
	gl_FragColor.rgb = tone == 0 ? NeutralToneMapping( gl_FragColor.rgb ) : tone == 1 ? ACESFilmicToneMapping( gl_FragColor.rgb ) : saturate( toneMappingExposure * gl_FragColor.rgb );
`;
/** Diffuse light of the environment comes from the light probe alone, also where highlights come from an environment map. */
const LIGHTS_BEGIN = ShaderChunk.lights_fragment_begin.replace(
  "#if defined( USE_LIGHT_PROBES )",
  "#if defined( USE_LIGHT_PROBES ) && ! defined( USE_ENVMAP )",
);
const LIGHTS_MAPS = ShaderChunk.lights_fragment_maps.replace(
  "iblIrradiance += getIBLIrradiance( geometryNormal );",
  "iblIrradiance += getLightProbeIrradiance( lightProbe, geometryNormal );",
);

/**
 * Make a material read colours per vertex and instance as sRGB, and add an offset to its depth, in units of the depth
 * range (-1..1). Return the material.
 */
export function patch<M extends Material>(material: M, depth = 0): M {
  const offset = `\n\tgl_Position.z += ${depth.toFixed(8)} * gl_Position.w;`;
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = shader.vertexShader.replace("#include <color_vertex>", LINEAR_COLORS).replace("gl_PointSize = size;", POINT_SIZE);
    if (material instanceof MeshLambertMaterial || material instanceof MeshStandardMaterial) grade(shader);
    if (depth === 0) return;
    // The first string is in the shaders of most materials, the second one in that of LineMaterial.
    for (const projected of ["#include <project_vertex>", "gl_Position = clip;"])
      shader.vertexShader = shader.vertexShader.replace(projected, projected + offset);
  };
  material.customProgramCacheKey = () => `scenegate ${depth}`;
  return material;
}

/** Light a surface as the gateway's images are. */
function grade(shader: WebGLProgramParametersWithUniforms): void {
  Object.assign(shader.uniforms, grading);
  shader.fragmentShader = shader.fragmentShader
    .replace("void main() {", "#include <tonemapping_pars_fragment>\nuniform int tone;\nvoid main() {")
    .replace("#include <lights_fragment_begin>", LIGHTS_BEGIN)
    .replace("#include <lights_fragment_maps>", LIGHTS_MAPS)
    .replace("#include <opaque_fragment>", LIT);
}
