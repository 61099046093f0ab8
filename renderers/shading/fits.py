"""Light of whole triangles under the look ``pbr``: of materials that are nothing but factors, shown levels are smooth
over most triangles, so that a polynomial of second degree over the picture stands for them. It is laid through the
corners and the middles of the edges; what it leaves is measured where it is largest, and a triangle that is not smooth
enough keeps its normals.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers import simd as vec
from renderers.linked import inlined, inner
from renderers.shading.lights import alpha_of, coat, cosines, gloss
from renderers.shading.materials import MF_BASE, MF_EMISSIVE, MF_METALLIC, MF_ROUGHNESS
from renderers.shading.transfer import encode_gamma

_ERROR: Final = 0.2
"""Levels at the places asked for. Of 400 000 triangles of random normals, materials and views that were taken, 1e-4
were off by more than half a level anywhere, none by a whole one."""
_HEIGHT: Final = 1.5
"""Pixels. Coverage is exact in 1/256 pixel: a pixel may lie beside its triangle by that, a 300th of its height."""
_BEYOND: Final = 0.011
"""How far a polynomial may leave its control points' range there, as a share of that: four times a 380th."""
_AREA: Final = 24.0
"""Twice the pixels of a triangle that is worth it: nine places are shaded, instead of all its pixels."""
_ASPECT: Final = 64.0
"""Longest edge over height. Terms grow with its square, and float32 leaves 1e-7 of them."""
_LEAST_COSINE: Final = np.float32(0.02)
"""Of light and view. Below zero nothing is lit, and what is shown changes beyond any bound above it."""
_SHARP: Final = 2.0
"""Square of how far normals and half vectors may turn from corner to corner, over GGX's alpha squared: else a
reflection could lie between the places asked for."""
_STEEP: Final = np.float32(0.62)
"""Cosine between view and light from which on ``lights.schlick`` is less than ``lights.FAINT``."""

# Of eight triangles, rows of eight float32 for each of three channels:
_NODES: Final = 0  # 3 corners, 3 middles of the edges behind them, 3 places nearer to them than to the others
F_LEVELS: Final = 27  # 3 times 6 rows, see ``planes.SMOOTH``
F_PLACE: Final = 45  # 2 rows: the pixel that they belong to
FIT_VALUES: Final = 47 * vec.LANES


@inlined
def _mixed(a, b, c, w):
    return (
        a[0] * w[0] + b[0] * w[1] + c[0] * w[2],
        a[1] * w[0] + b[1] * w[1] + c[1] * w[2],
        a[2] * w[0] + b[2] * w[1] + c[2] * w[2],
        a[3] * w[0] + b[3] * w[1] + c[3] * w[2],
        a[4] * w[0] + b[4] * w[1] + c[4] * w[2],
    )


@inlined
def _ask(n, a2, scattered, mirrored, emitted, alone, encoded, fit, at):
    """Put what is shown at eight places, 0 .. 1, into the rows ``at .. at + 2``: of a normal and a ray.

    Args:
        scattered, mirrored, emitted: of each channel, what ``lights.gloss``' first and second are multiplied by, and
            what is added. alone: whether the first channel is all that is wanted, and nothing but mirrored.

    Returns:
        Where nothing sharp is near.
    """
    one = vec.f32(1.0)
    n_l, n_v, v_l = cosines(n[0], n[1], n[2], n[3], n[4], n[4] * n[4] + one)
    least = vec.f32(_LEAST_COSINE)
    calm = (n_l > least) & (n_v > least) & (v_l > vec.f32(_STEEP))
    n_l, specular = gloss(n_l, n_v, v_l, a2)
    if alone:
        vec.store(fit, at * vec.LANES, encode_gamma(specular * mirrored[0], encoded))
    else:
        red = n_l * scattered[0] + specular * mirrored[0] + emitted[0]
        green = n_l * scattered[1] + specular * mirrored[1] + emitted[1]
        blue = n_l * scattered[2] + specular * mirrored[2] + emitted[2]
        vec.store(fit, at * vec.LANES, encode_gamma(red, encoded))
        vec.store(fit, (at + 1) * vec.LANES, encode_gamma(green, encoded))
        vec.store(fit, (at + 2) * vec.LANES, encode_gamma(blue, encoded))
    return calm


@inlined
def _corner(p, n):
    """Of a corner in the optical frame and its normal as seen (f64x8): the normal over depth, and where the ray meets
    the plane z = 1."""
    depth = vec.to_f32(p[2])
    near = vec.f32(1.0) / depth
    dx, dy = vec.to_f32(p[0]) * near, vec.to_f32(p[1]) * near
    return vec.to_f32(n[0]) * near, vec.to_f32(n[1]) * near, vec.to_f32(n[2]) * near, dx, dy


@inlined
def _turned(a, b):
    """Square of the distance of two corners' unit normals, plus that of their rays, which is more than their half
    vectors turn."""
    square_a, square_b = a[0] * a[0] + a[1] * a[1] + a[2] * a[2], b[0] * b[0] + b[1] * b[1] + b[2] * b[2]
    along = (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) / vec.sqrt(square_a * square_b)
    dx, dy = a[3] - b[3], a[4] - b[4]
    return vec.f32(2.0) - vec.f32(2.0) * along + (dx * dx + dy * dy) * vec.f32(0.25)


@inlined
def _bare(mf):
    """Whether a material is metal and does not shine by itself."""
    none = np.float32(0.0)
    dark = mf[MF_EMISSIVE] == none and mf[MF_EMISSIVE + 1] == none and mf[MF_EMISSIVE + 2] == none
    return dark and mf[MF_METALLIC] == np.float32(1.0)


@inlined
def _row(fit, row):
    return vec.load(fit, row * vec.LANES)


@inner
def fit_levels(p0, p1, p2, n0, n1, n2, lens, mf, encoded, fit):
    """Fit eight triangles.

    Args:
        p0, p1, p2: corners in the optical frame. n0, n1, n2: their normals as seen, see ``planes.seen_normals``. Three
            f64x8 each.
        mf: the material's values. encoded: address of ``ENCODED``.
        fit: pointer to FIT_VALUES float32, filled.

    Returns:
        Which ones are smooth enough: their bits.
    """
    none, one, two, half = vec.f32(0.0), vec.f32(1.0), vec.f32(2.0), vec.f32(0.5)
    a, b, c = _corner(p0, n0), _corner(p1, n1), _corner(p2, n2)
    fx, fy = vec.f32(lens[0]), vec.f32(lens[1])
    x1, y1, x2, y2 = (b[3] - a[3]) * fx, (b[4] - a[4]) * fy, (c[3] - a[3]) * fx, (c[4] - a[4]) * fy
    x3, y3 = x2 - x1, y2 - y1
    area = x1 * y2 - x2 * y1
    long = vec.most(vec.most(x1 * x1 + y1 * y1, x2 * x2 + y2 * y2), x3 * x3 + y3 * y3)
    size = vec.absolute(area)
    front = vec.least(vec.least(vec.to_f32(p0[2]), vec.to_f32(p1[2])), vec.to_f32(p2[2])) > none
    good = front & (size > vec.f32(_AREA)) & (size * size > long * vec.f32(_HEIGHT * _HEIGHT))
    good = good & (size * vec.f32(_ASPECT) > long)
    turned = vec.most(vec.most(_turned(a, b), _turned(b, c)), _turned(c, a))
    a2 = alpha_of(vec.f32(mf[MF_ROUGHNESS]))
    good = good & (turned < a2 * vec.f32(_SHARP))
    if vec.bits(good) == 0:
        return np.int64(0)
    vec.store(fit, F_PLACE * vec.LANES, a[3] * fx + vec.f32(lens[2] - 0.5))
    vec.store(fit, (F_PLACE + 1) * vec.LANES, a[4] * fy + vec.f32(lens[3] - 0.5))
    red, green, blue = vec.f32(mf[MF_BASE]), vec.f32(mf[MF_BASE + 1]), vec.f32(mf[MF_BASE + 2])
    diffuse, f0, _ = coat(red, green, blue, vec.f32(mf[MF_METALLIC]))
    scattered = diffuse[0] * (one - f0[0]), diffuse[1] * (one - f0[1]), diffuse[2] * (one - f0[2])
    emitted = vec.f32(mf[MF_EMISSIVE]), vec.f32(mf[MF_EMISSIVE + 1]), vec.f32(mf[MF_EMISSIVE + 2])
    # What a metal shows in its channels is in proportion: the brightest one's parabola is theirs.
    brightest = max(mf[MF_BASE], mf[MF_BASE + 1], mf[MF_BASE + 2])
    alone = brightest > np.float32(0.0) and _bare(mf)
    shares = f0
    if alone:
        whole = vec.f32(brightest)
        shares = (
            encode_gamma(f0[0] / whole, encoded),
            encode_gamma(f0[1] / whole, encoded),
            encode_gamma(f0[2] / whole, encoded),
        )
        f0 = whole, f0[1], f0[2]
    places = (half, half, none), (vec.f32(4.0 / 6.0), vec.f32(1.0 / 6.0), vec.f32(1.0 / 6.0))
    node = np.int64(_NODES)
    for _ in range(3):
        good = good & _ask(a, a2, scattered, f0, emitted, alone, encoded, fit, node)
        good = good & _ask(_mixed(a, b, c, places[0]), a2, scattered, f0, emitted, alone, encoded, fit, node + 9)
        good = good & _ask(_mixed(a, b, c, places[1]), a2, scattered, f0, emitted, alone, encoded, fit, node + 18)
        node += 3
        a, b, c = b, c, a
    scale = one / area
    # Barycentric coordinates of the second and the third corner: what a step to the right and one down add.
    bx, by, cx, cy = y2 * scale, -(x2 * scale), -(y1 * scale), x1 * scale
    three, four, nine, top = vec.f32(3.0), vec.f32(4.0), vec.f32(9.0), vec.f32(255.0)
    for k in range(1 if alone else 3):
        v0, v1, v2 = _row(fit, k), _row(fit, 3 + k), _row(fit, 6 + k)
        e0, e1, e2 = _row(fit, 9 + k), _row(fit, 12 + k), _row(fit, 15 + k)
        d0 = two * v0 - (v1 + v2) + four * (e0 + e2) + e1 - nine * _row(fit, 18 + k)
        d1 = two * v1 - (v2 + v0) + four * (e1 + e0) + e2 - nine * _row(fit, 21 + k)
        d2 = two * v2 - (v0 + v1) + four * (e2 + e1) + e0 - nine * _row(fit, 24 + k)
        worst = vec.most(vec.most(vec.absolute(d0), vec.absolute(d1)), vec.absolute(d2))
        good = good & (worst < vec.f32(9.0 * _ERROR / 255.0))
        # Bernstein: the polynomial stays between its control points.
        b0, b1, b2 = two * e0 - half * (v0 + v1), two * e1 - half * (v1 + v2), two * e2 - half * (v2 + v0)
        high = vec.most(vec.most(vec.most(v0, v1), vec.most(v2, b0)), vec.most(b1, b2))
        low = vec.least(vec.least(vec.least(v0, v1), vec.least(v2, b0)), vec.least(b1, b2))
        beyond = (high - low) * vec.f32(_BEYOND)
        good = good & (high + beyond < vec.f32(255.4 / 255.0)) & (low - beyond > vec.f32(-0.2 / 255.0))
        v0, v1, v2, e0, e1, e2 = v0 * top, v1 * top, v2 * top, e0 * top, e1 * top, e2 * top
        along, across = four * e0 - three * v0 - v1, four * e2 - three * v0 - v2
        bent, curled = two * (v0 + v1 - two * e0), two * (v0 + v2 - two * e2)
        both = four * (v0 + e1 - e0 - e2)
        at = (F_LEVELS + 6 * k) * vec.LANES
        vec.store(fit, at, v0)
        vec.store(fit, at + vec.LANES, along * bx + across * cx)
        vec.store(fit, at + 2 * vec.LANES, along * by + across * cy)
        vec.store(fit, at + 3 * vec.LANES, bent * bx * bx + curled * cx * cx + both * bx * cx)
        crossed = two * (bent * bx * by + curled * cx * cy) + both * (bx * cy + by * cx)
        vec.store(fit, at + 4 * vec.LANES, crossed)
        vec.store(fit, at + 5 * vec.LANES, bent * by * by + curled * cy * cy + both * by * cy)
    if alone:
        for k in range(F_LEVELS, F_LEVELS + 6):
            brightest_row = _row(fit, k)
            vec.store(fit, k * vec.LANES, brightest_row * shares[0])
            vec.store(fit, (k + 6) * vec.LANES, brightest_row * shares[1])
            vec.store(fit, (k + 12) * vec.LANES, brightest_row * shares[2])
    return vec.bits(good)
