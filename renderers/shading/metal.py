"""Metals that are nothing but factors and do not shine by themselves: all that they show is the head light's
reflection, and their channels are in proportion to one another, also as they are shown, since ``c^(1/2.2)`` of a
product is the product of both. So one root serves three channels.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.linked import inlined, inner
from renderers.pointers import f32_at
from renderers.shading.head import WHOLE
from renderers.shading.layout import S_ENCODED
from renderers.shading.lights import coat
from renderers.shading.materials import MF_BASE, MF_EMISSIVE, MF_METALLIC
from renderers.shading.transfer import GAMMA, ROOTS, root

_HIGHEST: Final = 2.0**16
"""Reflections above are cut off: what shows less than white of them is darker than black."""
_BRIGHTEST: Final = 2.0**8
"""The same for factors; there should be none above 1."""
_WHITE: Final = np.float32(255.0 * (_HIGHEST * _BRIGHTEST) ** (1.0 / GAMMA))


@inlined
def is_bare(mf):
    """Whether a material's reflection is all that it shows."""
    none = np.float32(0.0)
    dark = mf[MF_EMISSIVE] == none and mf[MF_EMISSIVE + 1] == none and mf[MF_EMISSIVE + 2] == none
    return dark and mf[MF_METALLIC] == np.float32(1.0)


@inner
def shares_of(job, mf, steep):
    """What ``show_metal`` needs of a bare metal; ``steep``: Schlick's term, see ``lights.reflected``."""
    table = f32_at(job[S_ENCODED])
    low, high = vec.load(table, ROOTS), vec.load(table, ROOTS + vec.LANES)
    red, green, blue = vec.f32(mf[MF_BASE]), vec.f32(mf[MF_BASE + 1]), vec.f32(mf[MF_BASE + 2])
    _, f0, grazing = coat(red, green, blue, vec.f32(1.0))
    grazed = vec.f32(steep)
    r, g, b = f0[0] + grazing[0] * grazed, f0[1] + grazing[1] * grazed, f0[2] + grazing[2] * grazed
    return low, high, _share(r, low, high), _share(g, low, high), _share(b, low, high)


@inlined
def _share(f, low, high):
    none = vec.f32(0.0)
    return vec.select(f > none, root(f * vec.f32(1.0 / _BRIGHTEST), low, high) * vec.f32(_WHITE), none)


@inlined
def show_metal(shares, specular, line, x):
    """Put eight pixels, packed, to the row that ``line`` points to: of a reflection, see ``lights.gloss``."""
    low, high, red, green, blue = shares
    shown = root(specular * vec.f32(1.0 / _HIGHEST), low, high)
    top, whole = vec.f32(255.0), vec.f32(WHOLE)
    r = vec.bits_of(vec.least(shown * red, top) + whole)
    g = vec.bits_of(vec.least(shown * green, top) + whole)
    b = vec.bits_of(vec.least(shown * blue, top) + whole)
    vec.store(line, x, r | (g << vec.i32(8)) | (b << vec.i32(16)))
