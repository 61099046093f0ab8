"""Reflection models, eight pixels at a time."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined

SMALLEST_COSINE: Final = np.float32(1e-5)
"""VTK's lower bound of the cosines in its shader; keeps the visibility term finite."""
_SMALLEST_ROUGHNESS: Final = np.float32(0.05)
"""RenderEngineVtk shades a material of roughness r as the formulae do with 0.05 + 0.95 r: measured on flat metal of
roughness 0 (0.05), on curved metal and dielectrics of 0.5 (0.525) and of 0.8 (0.81). It also keeps D finite."""
_HALF_PI_INVERSE: Final = np.float32(0.5 / math.pi)
_PI_INVERSE: Final = np.float32(1.0 / math.pi)
FAINT: Final = 1e-5
"""What ``schlick`` adds to a colour is not seen below this."""

# The light of a row is worked out in three steps, each over many pixels: the divisions and square roots of one pixel
# wait for one another, and of several such chains that are worked on at once, short ones leave more room for others.


@inlined
def cosines(nx, ny, towards, dx, dy, high):
    """What the head light's reflection depends on, eight pixels at a time: n . l, n . v, and v . l.

    The light shines along the optical axis: l = (0, 0, -1); v = -(dx, dy, 1) of unit length. Where the normal has no
    direction, n . l is 0 or not a number.

    Args:
        nx, ny, towards: normal of any length on the side that is seen, with minus its z, in the optical frame.
        dx, dy: where the pixel's ray meets the plane z = 1. high: dy^2 + 1. All f32x8.
    """
    ray, length = vec.sqrt(dx * dx + high), vec.sqrt(nx * nx + ny * ny + towards * towards)
    both = vec.select(length > vec.f32(0.0), vec.f32(1.0) / (length * ray), vec.f32(0.0))
    return towards * (both * ray), (towards - (nx * dx + ny * dy)) * both, both * length


@inlined
def alpha_of(roughness):
    """GGX's alpha squared of a material's roughness, f32x8."""
    rough = vec.f32(_SMALLEST_ROUGHNESS) + vec.f32(np.float32(1.0) - _SMALLEST_ROUGHNESS) * roughness
    rough = rough * rough
    return rough * rough


@inlined
def gloss(n_l, n_v, v_l, a2):
    """From ``cosines`` to n . l and D V n . l, both 0 where no light arrives.

    D is GGX (Walter 2007), V the height-correlated Smith term (Heitz 2014). With h = (v + l) / |v + l| and
    |v + l|^2 = w = 2 + 2 v . l they need neither h nor its length: n . h^2 = (n . v + n . l)^2 / w, so that
    D = a2 w^2 / (pi (w - (1 - a2) (n . v + n . l)^2)^2).
    """
    zero, one, two = vec.f32(0.0), vec.f32(1.0), vec.f32(2.0)
    lit = n_l > zero
    half = vec.most(n_v + n_l, zero)
    n_l, n_v = vec.most(n_l, vec.f32(SMALLEST_COSINE)), vec.most(n_v, vec.f32(SMALLEST_COSINE))
    wide, rest = two + two * v_l, one - a2
    d = wide - rest * (half * half)
    smith = n_l * vec.sqrt(a2 + rest * (n_v * n_v)) + n_v * vec.sqrt(a2 + rest * (n_l * n_l))
    specular = (a2 * vec.f32(_HALF_PI_INVERSE) * n_l * (wide * wide)) / (d * d * smith)
    return vec.select(lit, n_l, zero), vec.select(lit, specular, zero)


@inlined
def schlick(dx, dy):
    """Schlick's (1 - h . l)^5 of the pixel whose ray meets the plane z = 1 at (dx, dy), float32.

    With the light beside the eye it does not depend on the surface, grows with the distance from the optical axis and
    hardly differs from one pixel to another: 1e-5 at 50 degrees, 2e-4 at 70.
    """
    u = 1.0 - np.sqrt(0.5 + 0.5 / np.sqrt(dx * dx + dy * dy + 1.0))
    return np.float32((u * u) * (u * u) * u)


@inlined
def schlick_at(lens, y, x):
    """``schlick`` of pixel (x, y)."""
    return schlick((x + 0.5 - lens[2]) / lens[0], (y + 0.5 - lens[3]) / lens[1])


@inlined
def coat(red, green, blue, metallic):
    """Of a material's linear base colour (f32x8 each): the diffuse colours, those reflected at normal incidence
    (F0 = 0.04 for dielectrics), and what grazing light adds to these: F90 = clamp(16.5 (F0.r + F0.g + F0.b)), as VTK
    has it, minus F0."""
    zero, one = vec.f32(0.0), vec.f32(1.0)
    dielectric = one - metallic
    f0 = vec.f32(0.04) * dielectric
    r, g, b = f0 + red * metallic, f0 + green * metallic, f0 + blue * metallic
    f90 = vec.least(vec.most((r + g + b) * vec.f32(16.5), zero), one)
    diffuse = dielectric * vec.f32(_PI_INVERSE)
    return (diffuse * red, diffuse * green, diffuse * blue), (r, g, b), (f90 - r, f90 - g, f90 - b)


@inlined
def reflected(n_l, specular, schlick, diffuse, f0, grazing):
    """One channel's linear radiance towards the camera under one white head light of radiance 1, from ``gloss``,
    ``schlick`` (in all lanes) and ``coat``: metallic-roughness (glTF 2.0 appendix B) as VTK evaluates it, with the
    diffuse part (1 - F)(1 - metallic) base / pi. The light's radiance carries no factor pi."""
    f = f0 + grazing * schlick
    return n_l * (diffuse * (vec.f32(1.0) - f)) + specular * f
