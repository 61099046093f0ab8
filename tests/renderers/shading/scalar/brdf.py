"""Reflection models, one pixel at a time."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

_PI = np.float32(math.pi)
_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_MIN_COSINE = np.float32(1e-5)
"""VTK's lower limit of the cosines in its shader; keeps the visibility term finite."""
_MIN_ROUGHNESS = np.float32(0.05)
"""RenderEngineVtk shades a material of roughness r as the formulae do with 0.05 + 0.95 r: measured on flat metal of
roughness 0 (0.05), on curved metal and dielectrics of 0.5 (0.525) and of 0.8 (0.81). It also keeps D finite."""


@njit(nogil=True, error_model="numpy")
def _clamp_cosine(c):
    return min(max(c, _MIN_COSINE), _ONE)


@njit(nogil=True, error_model="numpy")
def reflect_pbr(nx, ny, nz, vx, vy, vz, red, green, blue, metallic, roughness):
    """Return the linear radiance towards the camera under one white headlight of radiance 1 along the optical axis.

    Metallic-roughness (glTF 2.0 appendix B) as VTK evaluates it: D is GGX (Walter 2007), V the height-correlated
    Smith term (Heitz 2014), F Schlick's with F0 = 0.04 for dielectrics and F90 = clamp(16.5 (F0.r + F0.g + F0.b)),
    the diffuse part (1 - F)(1 - metallic) base / pi. The light's radiance carries no factor pi.

    Args:
        nx, ny, nz: unit normal, vx, vy, vz: unit vector to the camera, both in the optical frame. All float32.
        red, green, blue: linear base colour.
    """
    n_l = -nz  # the light shines along +Z, so the vector to it is (0, 0, -1)
    hx, hy, hz = vx, vy, vz - _ONE
    scale = _ONE / math.sqrt(hx * hx + hy * hy + hz * hz)
    hx, hy, hz = hx * scale, hy * scale, hz * scale
    n_h = _clamp_cosine(nx * hx + ny * hy + nz * hz)
    n_v = _clamp_cosine(nx * vx + ny * vy + nz * vz)
    h_l = _clamp_cosine(-hz)
    n_l = _clamp_cosine(n_l)
    rough = _MIN_ROUGHNESS + (_ONE - _MIN_ROUGHNESS) * roughness
    a2 = rough * rough * rough * rough
    d = (n_h * a2 - n_h) * n_h + _ONE
    distribution = a2 / (_PI * d * d)
    ggx_v = n_l * math.sqrt(a2 + n_v * (n_v - a2 * n_v))
    ggx_l = n_v * math.sqrt(a2 + n_l * (n_l - a2 * n_l))
    visibility = np.float32(0.5) / (ggx_v + ggx_l)
    f0 = np.float32(0.04) * (_ONE - metallic)
    f0r, f0g, f0b = f0 + red * metallic, f0 + green * metallic, f0 + blue * metallic
    f90 = min(max((f0r + f0g + f0b) * np.float32(16.5), _ZERO), _ONE)
    m = _ONE - h_l
    m2 = m * m
    schlick = m2 * m2 * m
    fr, fg, fb = f0r + (f90 - f0r) * schlick, f0g + (f90 - f0g) * schlick, f0b + (f90 - f0b) * schlick
    specular = distribution * visibility
    diffuse = (_ONE - metallic) / _PI
    return (
        ((_ONE - fr) * diffuse * red + specular * fr) * n_l,
        ((_ONE - fg) * diffuse * green + specular * fg) * n_l,
        ((_ONE - fb) * diffuse * blue + specular * fb) * n_l,
    )
