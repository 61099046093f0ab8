"""How a surface reflects: glTF 2.0 appendix B with KHR_materials_ior and KHR_materials_specular."""

from __future__ import annotations

import math
from typing import Final

from numba import njit

_LEAST_ALPHA: Final = 1e-3
"""Of roughness squared: a mirror would show a point light as nothing."""


@njit(nogil=True, error_model="numpy")
def fifth(x):  # type: ignore[no-untyped-def]
    """The fifth power of Schlick's approximation, of 1 - cosine."""
    x = min(max(1.0 - x, 0.0), 1.0)
    return x * x * x * x * x


@njit(nogil=True, error_model="numpy")
def reflected(n, v, l, base, metallic, alpha, f0, f90):  # type: ignore[no-untyped-def]
    """The BRDF times the cosine of the light, RGB.

    GGX (Walter 2007) with the height-correlated Smith term (Heitz 2014); a dielectric is the mix of diffuse and
    specular by its largest Fresnel term, a metal reflects with its base colour.

    Args:
        n, v, l: unit vectors: normal, to the viewer, to the light.
        alpha: roughness squared. f0, f90: of the dielectric, RGB and a number.
    """
    n_l = n[0] * l[0] + n[1] * l[1] + n[2] * l[2]
    if not (n_l > 0.0):
        return 0.0, 0.0, 0.0
    n_v = max(abs(n[0] * v[0] + n[1] * v[1] + n[2] * v[2]), 1e-4)
    hx, hy, hz = v[0] + l[0], v[1] + l[1], v[2] + l[2]
    length = math.sqrt(hx * hx + hy * hy + hz * hz)
    scale = 1.0 / length if length > 0.0 else 0.0
    hx, hy, hz = hx * scale, hy * scale, hz * scale
    n_h = min(max(n[0] * hx + n[1] * hy + n[2] * hz, 0.0), 1.0)
    v_h = v[0] * hx + v[1] * hy + v[2] * hz
    alpha = max(alpha, _LEAST_ALPHA)
    a2 = alpha * alpha
    d = (n_h * a2 - n_h) * n_h + 1.0
    smith = n_l * math.sqrt(n_v * n_v * (1.0 - a2) + a2) + n_v * math.sqrt(n_l * n_l * (1.0 - a2) + a2)
    specular = a2 / (math.pi * d * d) * 0.5 / smith
    s = fifth(v_h)
    dr, dg, db = f0[0] + (f90 - f0[0]) * s, f0[1] + (f90 - f0[1]) * s, f0[2] + (f90 - f0[2]) * s
    diffuse = (1.0 - max(dr, max(dg, db))) * (1.0 - metallic) / math.pi
    dielectric = specular * (1.0 - metallic)
    metal = specular * metallic
    return (
        (diffuse * base[0] + dielectric * dr + metal * (base[0] + (1.0 - base[0]) * s)) * n_l,
        (diffuse * base[1] + dielectric * dg + metal * (base[1] + (1.0 - base[1]) * s)) * n_l,
        (diffuse * base[2] + dielectric * db + metal * (base[2] + (1.0 - base[2]) * s)) * n_l,
    )


@njit(nogil=True, error_model="numpy")
def ambient_channel(base, metallic, f0, f90, scale, bias, diffuse_light, specular_light):  # type: ignore[no-untyped-def]
    """One channel of the reflection of the surroundings.

    Args:
        base: base colour. f0, f90: of the dielectric.
        scale, bias: of F0 and F90 in the integral over a white hemisphere (``split_sum``).
        diffuse_light: irradiance over pi. specular_light: filtered radiance in the mirrored direction.

    The energy that the single-scattering model loses on rough surfaces comes back as Fdez-Aguera describes ("A
    Multiple-Scattering Microfacet Model for Real-Time Image-based Lighting", JCGT 2019).
    """
    lost = 1.0 - scale - bias
    single = f0 * scale + f90 * bias
    mean = f0 + (f90 - f0) / 21.0
    multiple = lost * single * mean / (1.0 - mean * lost)
    dielectric = single * specular_light + (multiple + base * max(1.0 - single - multiple, 0.0)) * diffuse_light
    single = base * scale + bias
    mean = base + (1.0 - base) / 21.0
    multiple = lost * single * mean / (1.0 - mean * lost)
    metal = single * specular_light + multiple * diffuse_light
    return dielectric + metallic * (metal - dielectric)
