"""Reflection models, eight pixels at a time."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numba import njit

from renderers import simd as vec

_PI: Final = np.float32(math.pi)
_SMALLEST_COSINE: Final = np.float32(1e-5)
"""VTK's lower bound of the cosines in its shader; keeps the visibility term finite."""
_SMALLEST_ROUGHNESS: Final = np.float32(0.05)
"""RenderEngineVtk shades a material of roughness r as the formulae do with 0.05 + 0.95 r: measured on flat metal of
roughness 0 (0.05), on curved metal and dielectrics of 0.5 (0.525) and of 0.8 (0.81). It also keeps D finite."""


@njit(nogil=True, error_model="numpy", forceinline=True)
def _clamped(c):  # type: ignore[no-untyped-def]
    return vec.least(vec.most(c, vec.f32(_SMALLEST_COSINE)), vec.f32(1.0))


@njit(nogil=True, error_model="numpy")
def reflect_pbr(nx, ny, nz, vx, vy, vz, red, green, blue, metallic, roughness):  # type: ignore[no-untyped-def]
    """Linear radiance towards the camera under one white head light of radiance 1 along the optical axis.

    Metallic-roughness (glTF 2.0 appendix B) as VTK evaluates it: D is GGX (Walter 2007), V the height-correlated
    Smith term (Heitz 2014), F Schlick's with F0 = 0.04 for dielectrics and F90 = clamp(16.5 (F0.r + F0.g + F0.b)),
    the diffuse part (1 - F)(1 - metallic) base / pi. The light's radiance carries no factor pi.

    Args:
        nx, ny, nz: unit normal, vx, vy, vz: unit vector to the camera, both in the optical frame. All f32x8.
        red, green, blue: linear base colour.
    """
    zero, one = vec.f32(0.0), vec.f32(1.0)
    towards = -nz  # the light shines along +Z, so the vector to it is (0, 0, -1)
    lit = towards > zero
    hz = vz - one
    scale = one / vec.sqrt(vx * vx + vy * vy + hz * hz)
    hx, hy, hz = vx * scale, vy * scale, hz * scale
    n_h = _clamped(nx * hx + ny * hy + nz * hz)
    n_v = _clamped(nx * vx + ny * vy + nz * vz)
    h_l = _clamped(-hz)
    n_l = _clamped(towards)
    rough = vec.f32(_SMALLEST_ROUGHNESS) + vec.f32(np.float32(1.0) - _SMALLEST_ROUGHNESS) * roughness
    rough = rough * rough
    a2 = rough * rough
    d = (n_h * a2 - n_h) * n_h + one
    ggx_v = n_l * vec.sqrt(a2 + n_v * (n_v - a2 * n_v))
    ggx_l = n_v * vec.sqrt(a2 + n_l * (n_l - a2 * n_l))
    # Distribution a2 / (pi d^2), times visibility 0.5 / (ggx_v + ggx_l).
    specular = a2 / (vec.f32(np.float32(2.0) * _PI) * d * d * (ggx_v + ggx_l))
    dielectric = one - metallic
    f0 = vec.f32(0.04) * dielectric
    f0r, f0g, f0b = f0 + red * metallic, f0 + green * metallic, f0 + blue * metallic
    f90 = vec.least(vec.most((f0r + f0g + f0b) * vec.f32(16.5), zero), one)
    m = one - h_l
    m2 = m * m
    schlick = m2 * m2 * m
    fr, fg, fb = f0r + (f90 - f0r) * schlick, f0g + (f90 - f0g) * schlick, f0b + (f90 - f0b) * schlick
    diffuse = dielectric * vec.f32(np.float32(1.0) / _PI)
    return (
        vec.select(lit, ((one - fr) * diffuse * red + specular * fr) * n_l, zero),
        vec.select(lit, ((one - fg) * diffuse * green + specular * fg) * n_l, zero),
        vec.select(lit, ((one - fb) * diffuse * blue + specular * fb) * n_l, zero),
    )
