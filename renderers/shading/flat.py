"""Long runs of flat surfaces under the look ``pbr``: their light changes so slowly that it is worked out for every
eighth pixel, and is a parabola between.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.linked import inner
from renderers.shading.compose import write
from renderers.shading.layout import A_BASE, A_COLOR
from renderers.shading.lights import alpha_of, coat, cosines, gloss, reflected, schlick
from renderers.shading.materials import MF_BASE, MF_EMISSIVE, MF_METALLIC, MF_ROUGHNESS

SHORTEST: Final = 16
"""Pixels of a run that is worth it; nodes lie eight pixels apart, one before the run and one behind."""
_LOBE: Final = 64.0
"""Focal length in pixels times GGX's alpha, which is how wide reflections are. From this on, what a parabola through
three nodes leaves of one is below 2e-4 of its peak, a twentieth of a level."""
_WIDE: Final = 0.5
"""Alpha that counts at most: light also changes with the direction of view."""
_GRAZING: Final = np.float32(0.25)
"""Cosine to the eye below which the visibility term changes faster."""


@inner
def changes_slowly(mf, lens):
    """Whether the light of a flat surface of this material may be a parabola over sixteen pixels."""
    alpha = vec.sqrt(alpha_of(vec.f32(mf[MF_ROUGHNESS])))
    return vec.bits(vec.least(alpha, vec.f32(_WIDE)) * vec.f32(lens[0]) >= vec.f32(_LOBE)) == 255


@inner
def show_flat(job, mf, lens, y, normal, rows, stride, begin, end, line, steep):
    """Pixels of one run of at least SHORTEST.

    Args:
        normal: three float32, of any length, on the side that is seen, with minus its z.
        mf: the material's values. lens: pointer to fx, fy, cx, cy.
        rows: rows of ``stride`` values, of which those from A_COLOR to A_BASE + 2 are used.
        line: pointer to the row's packed pixels; up to seven behind the run are overwritten.
        steep: see ``surface.row_schlick``.

    Returns:
        Whether it was done: not where the surface is seen at a grazing angle.
    """
    left, across = vec.f32(0.5 - lens[2]), vec.f32(1.0 / lens[0])
    dy = vec.f32((y + 0.5 - lens[3]) / lens[1])
    high = dy * dy + vec.f32(1.0)
    nx, ny, towards = vec.f32(normal[0]), vec.f32(normal[1]), vec.f32(normal[2])
    a2 = alpha_of(vec.f32(mf[MF_ROUGHNESS]))
    red, green, blue = vec.f32(mf[MF_BASE]), vec.f32(mf[MF_BASE + 1]), vec.f32(mf[MF_BASE + 2])
    diffuse, f0, grazing = coat(red, green, blue, vec.f32(mf[MF_METALLIC]))
    er, eg, eb = vec.f32(mf[MF_EMISSIVE]), vec.f32(mf[MF_EMISSIVE + 1]), vec.f32(mf[MF_EMISSIVE + 2])
    eight, half = vec.f32(8.0), vec.f32(0.5)
    if steep < np.float32(0.0):
        middle = 0.5 * (begin + end) - lens[2]
        steep = schlick(middle / lens[0], (y + 0.5 - lens[3]) / lens[1])
    grazed = vec.f32(steep)
    lane = vec.to_f32(vec.iota())
    pieces = (end - begin + 7) // 8
    nodes = A_BASE * stride
    for k in range(0, pieces + 2, vec.LANES):
        column = vec.f32(begin - 8) + (vec.f32(k) + lane) * eight
        n_l, n_v, v_l = cosines(nx, ny, towards, (column + left) * across, dy, high)
        ahead = vec.f32(k) + lane > vec.f32(pieces + 1)
        if vec.bits(ahead | (n_v > vec.f32(_GRAZING))) != 255:
            return False
        n_l, specular = gloss(n_l, n_v, v_l, a2)
        vec.store(rows, nodes + k, reflected(n_l, specular, grazed, diffuse[0], f0[0], grazing[0]) + er)
        vec.store(rows, nodes + stride + k, reflected(n_l, specular, grazed, diffuse[1], f0[1], grazing[1]) + eg)
        vec.store(rows, nodes + 2 * stride + k, reflected(n_l, specular, grazed, diffuse[2], f0[2], grazing[2]) + eb)
    t = lane / eight
    for channel in range(3):
        at, to = nodes + channel * stride, (A_COLOR + 2 * channel) * stride
        for k in range(0, pieces, vec.LANES):
            before, here, behind = vec.load(rows, at + k), vec.load(rows, at + k + 1), vec.load(rows, at + k + 2)
            vec.store(rows, to + k, (behind - before) * half)
            vec.store(rows, to + stride + k, (behind + before) * half - here)
    for k in range(pieces):
        at, to = nodes + k + 1, A_COLOR * stride + k
        r = vec.f32(rows[at]) + t * (vec.f32(rows[to]) + t * vec.f32(rows[to + stride]))
        at, to = at + stride, to + 2 * stride
        g = vec.f32(rows[at]) + t * (vec.f32(rows[to]) + t * vec.f32(rows[to + stride]))
        at, to = at + stride, to + 2 * stride
        b = vec.f32(rows[at]) + t * (vec.f32(rows[to]) + t * vec.f32(rows[to + stride]))
        write(job, True, line, begin + 8 * k, r, g, b)
    return True
