"""Reflection models, eight pixels at a time: VTK's for the headlight, and glTF 2.0 appendix B for the look ``studio``.

Both models are GGX (Walter 2007) with the height-correlated Smith term (Heitz 2014). They differ in clamps and in the
Fresnel term. The headlight shines along the optical axis, so that its model needs three cosines and no half vector.

Symbols: n unit normal, v unit vector to the viewer, l unit vector to the light, h their half vector; ``n_l`` is the
cosine n . l.
"""

import math
from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.simd import F32x8, F32x8x2, F32x8x3
from renderers.shading.vec3 import cross, dot, times

_VTK_MIN_COSINE: Final = np.float32(1e-5)
"""VTK's lower limit of the cosines in its shader; keeps the visibility term finite."""
_VTK_MIN_ROUGHNESS: Final = np.float32(0.05)
"""RenderEngineVtk shades a material of roughness r as the formulae do with 0.05 + 0.95 r. Measured on flat metal of
roughness 0 (0.05), on curved metal and dielectrics of 0.5 (0.525) and of 0.8 (0.81). It also keeps D finite."""
_MIN_ALPHA: Final = np.float32(1e-3)
"""Lower limit of alpha (roughness squared) in the look ``studio``. A perfect mirror would not show a point light."""


@inlined
def headlight_cosines(normal: F32x8x3, ray_x: F32x8, ray_y: F32x8) -> F32x8x3:
    """Return n . l, n . v and v . l for a light along the optical axis: l = (0, 0, -1), v = -(ray_x, ray_y, 1) / |ray|.

    Where the normal, which may have any length, has no direction, n . l is 0 or NaN.
    """
    zero, one = vec.f32(0.0), vec.f32(1.0)
    ray_length, normal_length = vec.sqrt(ray_x * ray_x + (ray_y * ray_y + one)), vec.sqrt(dot(normal, normal))
    inv_lengths = vec.select(normal_length > zero, one / (normal_length * ray_length), zero)
    n_l = (zero - normal[2]) * (inv_lengths * ray_length)
    n_v = zero - (normal[0] * ray_x + normal[1] * ray_y + normal[2]) * inv_lengths
    return n_l, n_v, inv_lengths * normal_length


@inlined
def vtk_specular(n_l: F32x8, n_v: F32x8, v_l: F32x8, roughness: F32x8) -> F32x8x2:
    """Return n . l, at least 1e-5, and D V n . l.

    D is the GGX distribution, V the Smith visibility term. The cosines are from ``headlight_cosines``. The minimum is
    VTK's: because of it, rough surfaces that face away from the light are not quite black.

    With h = (v + l) / |v + l| and |v + l|^2 = w = 2 + 2 v . l, neither h nor its length is needed:
    n . h^2 = (n . v + n . l)^2 / w, so D = a2 w^2 / (pi (w - (1 - a2) (n . v + n . l)^2)^2).
    """
    zero, one, two = vec.f32(0.0), vec.f32(1.0), vec.f32(2.0)
    alpha = vec.f32(_VTK_MIN_ROUGHNESS) + vec.f32(np.float32(1.0) - _VTK_MIN_ROUGHNESS) * roughness
    a2 = (alpha * alpha) * (alpha * alpha)
    cosine_sum = vec.maximum(n_v + n_l, zero)
    n_l, n_v = vec.maximum(n_l, vec.f32(_VTK_MIN_COSINE)), vec.maximum(n_v, vec.f32(_VTK_MIN_COSINE))
    w, one_minus_a2 = two + two * v_l, one - a2
    d = w - one_minus_a2 * (cosine_sum * cosine_sum)
    smith = n_l * vec.sqrt(a2 + one_minus_a2 * (n_v * n_v)) + n_v * vec.sqrt(a2 + one_minus_a2 * (n_l * n_l))
    specular = (a2 * vec.f32(0.5 / math.pi) * n_l * (w * w)) / (d * d * smith)
    return n_l, specular


@inlined
def schlick(v_l: F32x8) -> F32x8:
    """Return Schlick's (1 - h . l)^5, where h . l = sqrt((1 + v . l) / 2)."""
    half = vec.f32(0.5)
    s = vec.maximum(vec.f32(1.0) - vec.sqrt(half + half * v_l), vec.f32(0.0))
    return (s * s) * (s * s) * s


@inlined
def vtk_colors(base_color: F32x8x3, metallic: F32x8) -> tuple[F32x8x3, F32x8x3, F32x8x3]:
    """Return the diffuse colour, F0 and F90 - F0 of linear base colours.

    F0 is 0.04 for dielectrics; F90 = clamp(16.5 (F0.r + F0.g + F0.b)), as in VTK.
    """
    zero, one = vec.f32(0.0), vec.f32(1.0)
    dielectric_share = one - metallic
    dielectric_f0 = vec.f32(0.04) * dielectric_share
    r, g, b = (
        dielectric_f0 + base_color[0] * metallic,
        dielectric_f0 + base_color[1] * metallic,
        dielectric_f0 + base_color[2] * metallic,
    )
    f90 = vec.minimum(vec.maximum((r + g + b) * vec.f32(16.5), zero), one)
    diffuse = times(base_color, dielectric_share * vec.f32(1.0 / math.pi))
    return diffuse, (r, g, b), (f90 - r, f90 - g, f90 - b)


@inlined
def vtk_reflected(n_l: F32x8, specular: F32x8, fresnel: F32x8, diffuse: F32x8, f0: F32x8, f90_minus_f0: F32x8) -> F32x8:
    """Return one channel's linear radiance under a white headlight of radiance 1.

    This is metallic-roughness (glTF 2.0 appendix B) as VTK evaluates it. The diffuse part is (1 - F)(1 - metallic) base
    / pi. The arguments are from ``vtk_specular``, ``schlick`` and ``vtk_colors``.
    """
    f = f0 + f90_minus_f0 * fresnel
    return n_l * (diffuse * (vec.f32(1.0) - f)) + specular * f


@inlined
def reflected(
    n: F32x8x3,
    v: F32x8x3,
    l: F32x8x3,
    n_l: F32x8,
    base_color: F32x8x3,
    metallic: F32x8,
    roughness: F32x8,
    f0: F32x8x3,
    f90: F32x8,
) -> F32x8x3:
    """Return the BRDF times the cosine of the light, RGB; undefined where ``n_l`` is not positive.

    A dielectric, whose reflectance is ``f0`` at normal incidence and ``f90`` at grazing angles, mixes diffuse and
    specular reflection by the largest channel of its Fresnel term. A metal reflects with its base colour.
    """
    zero, one = vec.f32(0.0), vec.f32(1.0)
    n_v = vec.maximum(vec.absolute(dot(n, v)), vec.f32(1e-4))
    h = v[0] + l[0], v[1] + l[1], v[2] + l[2]
    length = vec.sqrt(dot(h, h))
    h = times(h, vec.select(length > zero, one / length, zero))
    v_h = dot(v, h)
    alpha = vec.maximum(roughness * roughness, vec.f32(_MIN_ALPHA))
    a2 = alpha * alpha
    # 1 - (n.h)^2 as the square of a sine: near a mirror's highlight, the difference would lose all digits of float32.
    sine = cross(n, h)
    sine2 = vec.minimum(dot(sine, sine), one)
    d = sine2 + (one - sine2) * a2
    one_minus_a2 = one - a2
    smith = n_l * vec.sqrt(n_v * n_v * one_minus_a2 + a2) + n_v * vec.sqrt(n_l * n_l * one_minus_a2 + a2)
    specular = a2 / (vec.f32(2.0 * math.pi) * d * d * smith)
    s = vec.minimum(vec.maximum(one - v_h, zero), one)
    s2 = s * s
    fresnel = s2 * s2 * s
    f_r, f_g, f_b = (f0[0] + (f90 - f0[0]) * fresnel, f0[1] + (f90 - f0[1]) * fresnel, f0[2] + (f90 - f0[2]) * fresnel)
    dielectric_share = one - metallic
    diffuse = (one - vec.maximum(f_r, vec.maximum(f_g, f_b))) * dielectric_share * vec.f32(1.0 / math.pi)
    dielectric, metal = specular * dielectric_share, specular * metallic
    r, g, b = base_color
    return (
        (diffuse * r + dielectric * f_r + metal * (r + (one - r) * fresnel)) * n_l,
        (diffuse * g + dielectric * f_g + metal * (g + (one - g) * fresnel)) * n_l,
        (diffuse * b + dielectric * f_b + metal * (b + (one - b) * fresnel)) * n_l,
    )


@inlined
def ambient_channel(
    base_color: F32x8,
    metallic: F32x8,
    f0: F32x8,
    f90: F32x8,
    scale: F32x8,
    bias: F32x8,
    diffuse_light: F32x8,
    specular_light: F32x8,
) -> F32x8:
    """Return one channel of the light that a surface reflects from the environment.

    Light that is scattered several times on rough surfaces is added as in Fdez-Aguera, "A Multiple-Scattering
    Microfacet Model for Real-Time Image-based Lighting" (JCGT 2019).

    Args:
        scale, bias: factors of F0 and F90 in the integral over a white hemisphere (``split_sum``).
        diffuse_light: irradiance divided by pi.
        specular_light: radiance around the mirrored direction, filtered for the roughness.
    """
    zero, one, mean_fresnel = vec.f32(0.0), vec.f32(1.0), vec.f32(1.0 / 21.0)
    lost = one - scale - bias
    single = f0 * scale + f90 * bias
    mean = f0 + (f90 - f0) * mean_fresnel
    multiple = lost * single * mean / (one - mean * lost)
    diffuse_share = vec.maximum(one - single - multiple, zero)
    dielectric = single * specular_light + (multiple + base_color * diffuse_share) * diffuse_light
    single = base_color * scale + bias
    mean = base_color + (one - base_color) * mean_fresnel
    multiple = lost * single * mean / (one - mean * lost)
    metal = single * specular_light + multiple * diffuse_light
    return dielectric + metallic * (metal - dielectric)
