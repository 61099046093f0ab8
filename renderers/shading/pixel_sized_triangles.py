"""Segments of one colour whose triangles are about as large as pixels: every lane is a pixel with a triangle of its
own.

Coordinates are float32, from the pixel's ray in the mesh's own frame: differences of a small triangle's vertices are
exact there, and nothing is transformed but the ray and the normal. (Moeller, Trumbore: Fast, minimum storage
ray-triangle intersection, 1997.)
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, i32_at, u32_at
from renderers.shading.headlight import colors_of, shine
from renderers.shading.layout import A_NORMAL, II_ELEMENTS, II_VERTICES, P_NORMAL
from renderers.shading.material import turned
from renderers.shading.prefetch import look_ahead
from renderers.shading.vec3 import cross, dot, minus

_SKEW: Final = 100.0
"""Condition (of Frobenius norms) of an instance's map up to which its mesh's frame is as good as the optical one: what
rounding moves a ray by, 2^-24 of its length, is that much longer in pixels, 0.01 in a picture 1000 pixels wide."""
_SCALES: Final = 1e-6, 1e6
"""Lengths in the mesh's frame of a metre: with these, products of three lengths are float32 from 1 um to 1000 km."""

# What of the view is needed in the mesh's frame, float64.
E_EYE: Final = 0  # 3 values: the camera's place
E_ORIGIN: Final = 3  # 3 values: the ray of column 0 of a row
E_STEP: Final = 6  # 3 values: what a column adds
E_SCALE: Final = 9  # square of a mesh's unit
E_VALUES: Final = 10


@inner
def look_from(m, maps, lens, y, eye):
    """Fill the E_VALUES float64 behind ``eye`` for one row of one instance.

    Returns:
        Whether float32 is good enough in the mesh's frame.
    """
    c0 = m[5] * m[10] - m[6] * m[9], m[6] * m[8] - m[4] * m[10], m[4] * m[9] - m[5] * m[8]
    c1 = m[9] * m[2] - m[10] * m[1], m[10] * m[0] - m[8] * m[2], m[8] * m[1] - m[9] * m[0]
    c2 = m[1] * m[6] - m[2] * m[5], m[2] * m[4] - m[0] * m[6], m[0] * m[5] - m[1] * m[4]
    determinant = m[0] * c0[0] + m[1] * c0[1] + m[2] * c0[2]
    size = np.sqrt(
        m[0] * m[0] + m[1] * m[1] + m[2] * m[2] + m[4] * m[4] + m[5] * m[5] + m[6] * m[6]
        + m[8] * m[8] + m[9] * m[9] + m[10] * m[10]
    )  # fmt: skip
    inverse = np.sqrt(dot(c0, c0) + dot(c1, c1) + dot(c2, c2)) / abs(determinant)
    unit = 1.0 / (inverse * inverse)
    eye[E_SCALE] = unit
    dx, dy = (0.5 - lens[2]) / lens[0], (y + 0.5 - lens[3]) / lens[1]
    for k in range(3):
        eye[E_EYE + k] = -(c0[k] * m[3] + c1[k] * m[7] + c2[k] * m[11]) / determinant
        # The inverse up to a positive factor is the transpose of the map of normals.
        across = unit * maps[P_NORMAL + k]
        eye[E_STEP + k] = across / lens[0]
        eye[E_ORIGIN + k] = across * dx + unit * (maps[P_NORMAL + 3 + k] * dy + maps[P_NORMAL + 6 + k])
    return size * inverse < _SKEW and _SCALES[0] < inverse and inverse < _SCALES[1]


@inlined
def _apart(value):
    """A float64 as the sum of two float32, in all lanes."""
    high = np.float32(value)
    return vec.f32(high), vec.f32(value - np.float64(high))


@inner
def show_tiny(
    columns, maps, places, first, many, smooth, mf, ids, begin, end, shown, rows, stride, line, eye, spare
):  # fmt: skip
    """The pixels ``begin .. end`` of one instance's triangles, whose colour is the material's factor.

    Args:
        columns .. mf: as for ``plain.show_plain``.
        ids: pointer to the row's records.
        shown: lit by the head light they go to ``line``, a pointer to the row's packed pixels; if not ``shown``, their
            normals go to ``rows``, as from ``plain_pbr``. Up to seven pixels behind the last are overwritten.
        eye: see ``look_from``. spare: pointer to 8 int32.
    """
    elements, vertices = u32_at(columns[II_ELEMENTS]), f32_at(columns[II_VERTICES])
    colors = colors_of(mf)
    lane, none, one = vec.iota(), vec.f32(0.0), vec.f32(1.0)
    x_eye, x_rest = _apart(eye[E_EYE])
    y_eye, y_rest = _apart(eye[E_EYE + 1])
    z_eye, z_rest = _apart(eye[E_EYE + 2])
    origin = vec.f32(eye[E_ORIGIN]), vec.f32(eye[E_ORIGIN + 1]), vec.f32(eye[E_ORIGIN + 2])
    unit = vec.f32(eye[E_SCALE])
    step = vec.f32(eye[E_STEP]), vec.f32(eye[E_STEP + 1]), vec.f32(eye[E_STEP + 2])
    for x in range(begin, end, vec.LANES):
        if many:
            look_ahead(ids, x, end, first, elements, vertices)
        records, at = ids, np.int64(x)
        if x + vec.LANES > end:  # what lies behind may belong to another instance
            inside = lane < vec.i32(end - x)
            vec.store(spare, 0, vec.select(inside, vec.load(ids, x), vec.i32(np.int64(ids[x]))))
            records, at = spare, np.int64(0)
        v0 = vec.load_vertices(records, at, first, elements, vertices, 0)
        v1 = vec.load_vertices(records, at, first, elements, vertices, 1)
        v2 = vec.load_vertices(records, at, first, elements, vertices, 2)
        column = vec.to_f32(vec.i32(x) + lane if places == 0 else vec.load(i32_at(places), x))
        d = origin[0] + step[0] * column, origin[1] + step[1] * column, origin[2] + step[2] * column
        e1, e2 = minus(v1, v0), minus(v2, v0)
        n = cross(e1, e2)
        side = dot(d, n)
        facing = vec.select(side > none, -one, one)
        if smooth:
            s = (x_eye - v0[0]) + x_rest, (y_eye - v0[1]) + y_rest, (z_eye - v0[2]) + z_rest
            w1, w2 = facing * dot(s, cross(d, e2)), facing * dot(d, cross(s, e1))
            w0 = vec.absolute(side) - w1 - w2
            # As in plain: nothing is extrapolated.
            w0, w1, w2 = vec.most(w0, none), vec.most(w1, none), vec.most(w2, none)
            n = (
                w0 * v0[3] + w1 * v1[3] + w2 * v2[3],
                w0 * v0[4] + w1 * v1[4] + w2 * v2[4],
                w0 * v0[5] + w1 * v1[5] + w2 * v2[5],
            )
        else:
            n = n[0] * unit, n[1] * unit, n[2] * unit
        nx, ny, nz = turned(maps, P_NORMAL, n[0], n[1], n[2])
        nz = -(nz * facing)
        if shown:
            vec.store(line, x, shine(nz, nx * nx + ny * ny + nz * nz, colors))
        else:
            at = A_NORMAL * stride + x
            vec.store(rows, at, nx * facing)
            vec.store(rows, at + stride, ny * facing)
            vec.store(rows, at + 2 * stride, nz)
