"""How surfaces reflect, eight pixels at a time: glTF 2.0 appendix B, KHR_materials_ior and KHR_materials_specular."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inner

_LEAST_ALPHA: Final = np.float32(1e-3)
"""Of roughness squared: a mirror would show a point light as nothing."""


@inner
def reflected(n, v, l, n_l, base, metallic, roughness, f0, f90):
    """The BRDF times the cosine of the light, RGB; meaningless where ``n_l`` is not above 0.

    GGX (Walter 2007) with the height-correlated Smith term (Heitz 2014); a dielectric is the mix of diffuse and
    specular by its largest Fresnel term, a metal reflects with its base colour.

    Args:
        n, v, l: unit vectors: normal, to the viewer, to the light; three f32x8 each. n_l: their cosine.
        f0, f90: of the dielectric, RGB and an f32x8.
    """
    zero, one = vec.f32(0.0), vec.f32(1.0)
    n_v = vec.most(vec.absolute(n[0] * v[0] + n[1] * v[1] + n[2] * v[2]), vec.f32(1e-4))
    hx, hy, hz = v[0] + l[0], v[1] + l[1], v[2] + l[2]
    length = vec.sqrt(hx * hx + hy * hy + hz * hz)
    scale = vec.select(length > zero, one / length, zero)
    hx, hy, hz = hx * scale, hy * scale, hz * scale
    v_h = v[0] * hx + v[1] * hy + v[2] * hz
    alpha = vec.most(roughness * roughness, vec.f32(_LEAST_ALPHA))
    a2 = alpha * alpha
    # 1 - (n.h)^2 as the square of a sine: float32 has no digits left for the difference near a mirror's highlight.
    cx, cy, cz = n[1] * hz - n[2] * hy, n[2] * hx - n[0] * hz, n[0] * hy - n[1] * hx
    sine2 = vec.least(cx * cx + cy * cy + cz * cz, one)
    d = sine2 + (one - sine2) * a2
    keep = one - a2
    smith = n_l * vec.sqrt(n_v * n_v * keep + a2) + n_v * vec.sqrt(n_l * n_l * keep + a2)
    specular = a2 / (vec.f32(2.0 * math.pi) * d * d * smith)
    s = vec.least(vec.most(one - v_h, zero), one)
    s2 = s * s
    s = s2 * s2 * s
    dr, dg, db = f0[0] + (f90 - f0[0]) * s, f0[1] + (f90 - f0[1]) * s, f0[2] + (f90 - f0[2]) * s
    dull = one - metallic
    diffuse = (one - vec.most(dr, vec.most(dg, db))) * dull * vec.f32(1.0 / math.pi)
    dielectric, metal = specular * dull, specular * metallic
    return (
        (diffuse * base[0] + dielectric * dr + metal * (base[0] + (one - base[0]) * s)) * n_l,
        (diffuse * base[1] + dielectric * dg + metal * (base[1] + (one - base[1]) * s)) * n_l,
        (diffuse * base[2] + dielectric * db + metal * (base[2] + (one - base[2]) * s)) * n_l,
    )


@inner
def ambient_channel(base, metallic, f0, f90, scale, bias, diffuse_light, specular_light):
    """One channel of the reflection of the surroundings; all f32x8.

    Args:
        base: base colour. f0, f90: of the dielectric.
        scale, bias: of F0 and F90 in the integral over a white hemisphere (``split_sum``).
        diffuse_light: irradiance over pi. specular_light: filtered radiance in the mirrored direction.

    The energy that the single-scattering model loses on rough surfaces comes back as Fdez-Aguera describes ("A
    Multiple-Scattering Microfacet Model for Real-Time Image-based Lighting", JCGT 2019).
    """
    zero, one, part = vec.f32(0.0), vec.f32(1.0), vec.f32(1.0 / 21.0)
    lost = one - scale - bias
    single = f0 * scale + f90 * bias
    mean = f0 + (f90 - f0) * part
    multiple = lost * single * mean / (one - mean * lost)
    left = vec.most(one - single - multiple, zero)
    dielectric = single * specular_light + (multiple + base * left) * diffuse_light
    single = base * scale + bias
    mean = base + (one - base) * part
    multiple = lost * single * mean / (one - mean * lost)
    metal = single * specular_light + multiple * diffuse_light
    return dielectric + metallic * (metal - dielectric)
