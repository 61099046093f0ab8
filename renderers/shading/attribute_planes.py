"""What is linear over a triangle, as planes over the picture, remembered from one row of a band to the next.

With the vertices in the optical frame as the columns of P, the barycentric coordinates of a pixel's ray d, divided by
its depth, are ``P^-1 d``: linear over the picture, and so is what they weigh as long as only its direction counts: the
normal. They are float32, from a pixel on that sees the triangle: within a band, rounding has little to add up.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined, inner
from renderers.compiler.pointers import f32_at, i32_at, u32_at
from renderers.shading.headlight import shine
from renderers.shading.layout import II_ELEMENTS, II_VERTICES, P_MIRROR, P_NORMAL
from renderers.shading.material import turned
from renderers.shading.vec3 import cross, dot, minus, optical

SLOTS: Final = 4096
"""Triangles that are remembered, a place for each by the low bits of its record: several times what a row sees."""
AHEAD: Final = 128
"""Runs that are looked up at a time: few enough that they seldom put each other out of their places."""

# The memory of triangles with a picture on them, values of 4 bytes.
M_RECORDS: Final = 0  # SLOTS: whose triangle's; -1: nobody's
M_PIXELS: Final = SLOTS  # SLOTS: see ``texel_planes``
M_MISSING: Final = 2 * SLOTS  # AHEAD and a vector more: records that are to be set up
M_COLUMNS: Final = M_MISSING + AHEAD + vec.LANES  # as many: the columns that they are needed at
M_PLANES: Final = M_COLUMNS + AHEAD + vec.LANES  # float32 from here on: PLANE_VALUES for every place
ROW_VALUES: Final = 8
PLANE_VALUES: Final = 3 * ROW_VALUES
"""A row at one pixel, a row of what a step down adds, and one of what a step to the right adds."""
MEMORY_VALUES: Final = M_PLANES + SLOTS * PLANE_VALUES

# A row: the normal, turned to the side that is seen, with minus its z, which is what the head light sees of it ...
PL_NORMAL: Final = 0  # 3 values
PL_WEIGHTS: Final = 3  # 3 values: barycentric coordinates over depth
# ... and in the first row only:
PL_FACING: Final = 6  # -1 where a back face is seen
PL_PIXEL: Final = 7  # int32: the packed pixel of a triangle that has the same colour everywhere, else -1
# in the second and third:
PL_COLUMN: Final = ROW_VALUES + 6  # the pixel that the first row belongs to
PL_LINE: Final = 2 * ROW_VALUES + 6

# Up to eight triangles of one instance that wait for their set-up, int32: their records, the pixels that see them
# first, and their places.
E_RECORDS: Final = 0
E_LEFT: Final = vec.LANES
E_TOP: Final = 2 * vec.LANES
E_PLACES: Final = 3 * vec.LANES
E_INSTANCE: Final = 4 * vec.LANES
E_COUNT: Final = E_INSTANCE + 1
E_COLUMNS: Final = 5 * vec.LANES


@inner
def forget(memory):
    """Empty the memory, MEMORY_VALUES of 4 bytes at that address."""
    records = i32_at(memory)
    for slot in range(0, SLOTS, vec.LANES):
        vec.store(records, M_RECORDS + slot, vec.i32(-1))


@inner
def look_up(ids, starts, places, run, last_run, memory):
    """Find out which of the runs' triangles are missing: at most AHEAD of them.

    Returns:
        How many; the last one is repeated behind them.
    """
    whole = i32_at(memory)
    count = np.int64(0)
    for batch in range(run, last_run, vec.LANES):
        begins = vec.load(starts, batch)
        records = vec.gather(ids, begins)
        known = vec.gather(whole, (records & vec.i32(SLOTS - 1)) + vec.i32(M_RECORDS))
        missing = (records != known) & (vec.i32(batch) + vec.iota() < vec.i32(last_run))
        vec.store(whole, M_MISSING + count, vec.compressed(missing, records))
        vec.store(whole, M_COLUMNS + count, vec.compressed(missing, begins))
        count += vec.count_bits(vec.bits(missing))
    if count > 0:
        if places != 0:
            for k in range(count):
                whole[M_COLUMNS + k] = i32_at(places)[whole[M_COLUMNS + k]]
        vec.store(whole, M_MISSING + count, vec.i32(np.int64(whole[M_MISSING + count - 1])))
        vec.store(whole, M_COLUMNS + count, vec.i32(np.int64(whole[M_COLUMNS + count - 1])))
    return count


@inlined
def inverse(p0, p1, p2):
    """Rows of det(P) P^-1, and the determinant ((p1 - p0) x (p2 - p0)) . p0: negative where a counter-clockwise element
    is seen from its front. A mirroring map turns that round."""
    rows = cross(p1, p2), cross(p2, p0), cross(p0, p1)
    return rows, dot(p0, rows[0])


@inlined
def spread_out(rows, scale, lens, column, row):
    """Barycentric coordinates over depth, times a factor, at a pixel, and what a step to the right and one down add:
    three f64x8 each.

    Args:
        rows: see ``inverse``. scale: f64x8, a factor over the determinant. column, row: of the pixel.
    """
    sx, sy = scale * vec.f64(1.0 / lens[0]), scale * vec.f64(1.0 / lens[1])
    left, top = column + vec.f64(0.5 - lens[2]), row + vec.f64(0.5 - lens[3])
    right = rows[0][0] * sx, rows[1][0] * sx, rows[2][0] * sx
    down = rows[0][1] * sy, rows[1][1] * sy, rows[2][1] * sy
    here = (
        rows[0][2] * scale + right[0] * left + down[0] * top,
        rows[1][2] * scale + right[1] * left + down[1] * top,
        rows[2][2] * scale + right[2] * left + down[2] * top,
    )
    return here, right, down


@inlined
def seen_normals(maps, corner, facing):
    """A corner's normal as in a row, f64x8, from a vertex's six values."""
    nx, ny, nz = turned(maps, P_NORMAL, corner[3], corner[4], corner[5])
    return vec.to_f64(nx * facing), vec.to_f64(ny * facing), vec.to_f64(-(nz * facing))


@inlined
def _same(a, b):
    return (a[3] == b[3]) & (a[4] == b[4]) & (a[5] == b[5])


@inlined
def _keep(planes, places, a, b, c, w, more, last):
    """Store a row of eight triangles: the corners' normals with their weights, these, and two values more."""
    x, y, z = (
        w[0] * a[0] + w[1] * b[0] + w[2] * c[0],
        w[0] * a[1] + w[1] * b[1] + w[2] * c[1],
        w[0] * a[2] + w[1] * b[2] + w[2] * c[2],
    )
    x, y, z = vec.to_f32(x), vec.to_f32(y), vec.to_f32(z)
    row = x, y, z, vec.to_f32(w[0]), vec.to_f32(w[1]), vec.to_f32(w[2]), more, last
    vec.store_rows(planes, places, row)


@inner
def set_up(columns, m, maps, lens, first, smooth, colors, eight, planes):
    """Put eight triangles of an instance, not all of which need differ, to their places.

    Args:
        columns, m, lens, first: as for ``resolve.resolve_triangles``.
        maps: pointer to the instance's P_COLUMNS values.
        smooth: whether the mesh has normals; if not, PL_PIXEL is all that is known. colors: see ``head.shine``.
        eight: pointer to E_COLUMNS int32. planes: pointer to float32, PLANE_VALUES for every place.
    """
    vertices, elements = f32_at(columns[II_VERTICES]), u32_at(columns[II_ELEMENTS])
    column, row = vec.to_f64(vec.load(eight, E_LEFT)), vec.to_f64(vec.load(eight, E_TOP))
    v0 = vec.load_vertices(eight, E_RECORDS, first, elements, vertices, 0)
    v1 = vec.load_vertices(eight, E_RECORDS, first, elements, vertices, 1)
    v2 = vec.load_vertices(eight, E_RECORDS, first, elements, vertices, 2)
    p0, p1, p2 = optical(m, v0), optical(m, v1), optical(m, v2)
    rows, determinant = inverse(p0, p1, p2)
    none, one = vec.f64(0.0), vec.f64(1.0)
    mirror = np.float64(maps[P_MIRROR])
    places = vec.load(eight, E_PLACES) * vec.i32(PLANE_VALUES)
    if not smooth:
        n = cross(minus(p1, p0), minus(p2, p0))
        # Against the sign of the determinant: towards the camera.
        nz = vec.select(determinant < none, -n[2], n[2])
        length = vec.sqrt(dot(n, n))
        usable = (length > none) & (length < vec.f64(math.inf))
        nz = vec.select(usable, nz / vec.select(usable, length, one), none)
        pixels = shine(vec.to_f32(nz), vec.f32(1.0), colors) & vec.i32(0xFFFFFF)
        vec.scatter(planes, places + vec.i32(PL_PIXEL), vec.float_of(pixels))
        return
    facing = vec.select(determinant > none, vec.f64(-mirror), vec.f64(mirror))
    side = vec.to_f32(facing)
    n0, n1, n2 = seen_normals(maps, v0, side), seen_normals(maps, v1, side), seen_normals(maps, v2, side)
    z, square = vec.to_f32(n0[2]), vec.to_f32(dot(n0, n0))
    uniform = _same(v0, v1) & _same(v0, v2)
    pixels = vec.select(uniform, shine(z, square, colors) & vec.i32(0xFFFFFF), vec.i32(-1))
    # Of triangles that are seen edge-on, any positive factor will do.
    size = vec.absolute(determinant)
    usable = (size > none) & (size < vec.f64(math.inf))
    scale = one / vec.select(usable, size, one)
    scale = vec.select(determinant < none, -scale, scale)
    here, right, down = spread_out(rows, scale, lens, column, row)
    _keep(planes, places, n0, n1, n2, here, side, vec.float_of(pixels))
    column, row = vec.to_f32(column), vec.to_f32(row)
    _keep(planes, places + vec.i32(ROW_VALUES), n0, n1, n2, down, column, column)
    _keep(planes, places + vec.i32(2 * ROW_VALUES), n0, n1, n2, right, row, row)
