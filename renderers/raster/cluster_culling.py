"""Sixteen triangles at a time that cannot be seen: turned away from the camera, or outside of the picture.

Neighbours in a mesh's order lie near one another and face much the same way. Of every sixteen a sphere and a cone are
known, which hold their corners and their normals; where all that these allow is turned away (the axis, too: the sum of
its angle and the cone's must stay below a half turn), or beyond one side of the picture, the sixteen are never looked
at. That is more than half of most closed surfaces. (Shirman, Abi-Ezzi: The cone
of normals technique for fast processing of curved patches, 1993.)

What is left out, setup would have culled: the pixels are the same. A triangle that faces away might still turn to the
camera where its corners are snapped to the grid. Let F be the greater focal length in pixels, B the greatest factor by
which the instance's map stretches, h the least height of a triangle in the mesh's frame and K the least distance of
the eye behind a triangle's plane; fx fy |det| = k F^2 B^3; z .. Z the range of depths. Twice the area of its picture is
fx fy |det| n . (p - eye) / (z0 z1 z2), n being as long as the longest edge l times the height on it, and no edge of the
picture is longer than F B l (1 + t) / z, t being the tangent of the angle to the optical axis. Corners that move by d
each way change twice the area by at most 2 sqrt(2) d times the sum of two edges, plus 8 d^2. Hence, with e = h F B / Z,

    k e (K B / Z) (z / Z) > 4 sqrt(2) d (1 + t) + 8 d^2 / e

holds only where the sign stays.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inner
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import f32_at, f64_at, i64_at, u32_at
from renderers.raster.layout import (
    J_BANDS,
    J_HEIGHT,
    J_LENGTHS,
    J_LISTS,
    J_TABLE,
    J_WIDTH,
    L_CX,
    L_CY,
    L_FX,
    L_FY,
    L_NEAR,
    M_COLUMNS,
    T_COLUMNS,
    T_CULL,
    T_HIDDEN,
)

SHIFT: Final = 4
CLUSTER: Final = 1 << SHIFT
"""Triangles of a cluster: enough that to look at it costs little, few enough that a row of a ball's grid is several."""
WORTH: Final = 64
"""Triangles of a mesh from which on to ask costs less than it saves."""

# Of every eight clusters, eight float32 each: middle and radius of the sphere; axis, cosine and sine of the cone; the
# least height of a triangle, 0: nothing is known of the normals; how far behind their planes the middle is at least.
C_MIDDLE: Final = 0
C_RADIUS: Final = 3
C_AXIS: Final = 4
C_COSINE: Final = 7
C_SINE: Final = 8
C_HEIGHT: Final = 9
C_OFFSET: Final = 10
C_COLUMNS: Final = 11

# An instance's view, float32, in its mesh's frame: the eye, the inward normals of the picture's four sides, what depth
# grows by along the axes and at most, B, F B, k, the sum of the eye's coordinates, the near plane.
V_EYE: Final = 0
V_SIDES: Final = 3
V_DEPTH: Final = 15
V_STEEPEST: Final = 18
V_STRETCH: Final = 19
V_PIXELS: Final = 20
V_SKEW: Final = 21
V_FAR: Final = 22
V_NEAR: Final = 23
V_COLUMNS: Final = 24

_MOVED: Final = 0.0172
"""4 sqrt(2) d with d = 1/512 pixel by snapping and 1/1024 by float32 within the guard band, and some more."""
_LOWEST: Final = 0.02
"""Pixels: e, below which nothing is said; above it 8 d^2 / e is below 0.004."""
_REST: Final = 0.004
_SLACK: Final = 4e-6
"""Of the coordinates: what float32 may lose of a distance."""
_CONDITION: Final = 1e3


def cluster_values(triangles: int) -> int:
    """float32 that ``bound_clusters`` fills: whole eights."""
    return -(-triangles // (8 * CLUSTER)) * 8 * C_COLUMNS


@kernel("void(int64, int64, int64, int64, int64)")
def bound_clusters(positions_at, elements_at, triangles, out_at, stop_at):
    """Spheres and cones of a mesh's clusters.

    Args:
        positions_at, elements_at, triangles: the mesh, float32 and uint32.
        out_at: address of ``cluster_values(triangles)`` float32, all 0.
        stop_at: address of a ``StopFlag``; what is filled is of no use once it is set.
    """
    positions, indices, out = f32_at(positions_at), u32_at(elements_at), f32_at(out_at)
    own = np.empty((CLUSTER, 4), np.float64)
    for cluster in range((triangles + CLUSTER - 1) // CLUSTER):
        if is_set(stop_at):
            break
        at = (cluster >> 3) * 8 * C_COLUMNS + (cluster & 7)
        begin, end = 3 * CLUSTER * cluster, 3 * min(CLUSTER * (cluster + 1), triangles)
        first = 3 * np.int64(indices[begin])
        lx = hx = np.float64(positions[first])
        ly = hy = np.float64(positions[first + 1])
        lz = hz = np.float64(positions[first + 2])
        ax = ay = az = 0.0
        known, height = 0, np.inf
        for k in range(begin, end, 3):
            a, b, c = 3 * np.int64(indices[k]), 3 * np.int64(indices[k + 1]), 3 * np.int64(indices[k + 2])
            x, y, z = np.float64(positions[a]), np.float64(positions[a + 1]), np.float64(positions[a + 2])
            x1, y1, z1 = np.float64(positions[b]), np.float64(positions[b + 1]), np.float64(positions[b + 2])
            x2, y2, z2 = np.float64(positions[c]), np.float64(positions[c + 1]), np.float64(positions[c + 2])
            lx, hx = min(lx, x, x1, x2), max(hx, x, x1, x2)
            ly, hy = min(ly, y, y1, y2), max(hy, y, y1, y2)
            lz, hz = min(lz, z, z1, z2), max(hz, z, z1, z2)
            ux, uy, uz, vx, vy, vz = x1 - x, y1 - y, z1 - z, x2 - x, y2 - y, z2 - z
            wx, wy, wz = x2 - x1, y2 - y1, z2 - z1
            uu, vv, ww = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
            if uu == 0.0 or vv == 0.0 or ww == 0.0:
                continue  # two corners in one place: seen from nowhere
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            nn = nx * nx + ny * ny + nz * nz
            height = min(height, nn / max(uu, vv, ww))
            scale = 1.0 / np.sqrt(nn)
            nx, ny, nz = nx * scale, ny * scale, nz * scale
            own[known, 0], own[known, 1], own[known, 2], own[known, 3] = nx, ny, nz, nx * x + ny * y + nz * z
            known += 1
            ax, ay, az = ax + nx, ay + ny, az + nz
        mx, my, mz = np.float32(0.5 * (lx + hx)), np.float32(0.5 * (ly + hy)), np.float32(0.5 * (lz + hz))
        rx, ry, rz = max(hx - mx, mx - lx), max(hy - my, my - ly), max(hz - mz, mz - lz)
        radius = np.sqrt(rx * rx + ry * ry + rz * rz)
        length = np.sqrt(ax * ax + ay * ay + az * az)
        cosine, offset = 1.0, np.inf
        for k in range(known):
            cosine = min(cosine, (own[k, 0] * ax + own[k, 1] * ay + own[k, 2] * az) / length)
            offset = min(offset, own[k, 3] - (own[k, 0] * mx + own[k, 1] * my + own[k, 2] * mz))
        cosine -= 1e-6
        # Values that are not finite make comparisons fail, here and later.
        facing = known > 0 and length > 0.0 and cosine > 0.0 and height > 0.0
        out[at] = mx
        out[at + 8] = my
        out[at + 16] = mz
        out[at + 8 * C_RADIUS] = radius * 1.000001
        if facing:
            out[at + 8 * C_AXIS] = ax / length
            out[at + 8 * C_AXIS + 8] = ay / length
            out[at + 8 * C_AXIS + 16] = az / length
            out[at + 8 * C_COSINE] = cosine
            out[at + 8 * C_SINE] = np.sqrt(max(1.0 - cosine * cosine, 0.0)) + 1e-6
            out[at + 8 * C_HEIGHT] = np.sqrt(height) * 0.999999
            out[at + 8 * C_OFFSET] = offset - 1e-6 * radius


@inner
def look_at(job, lens, drawn, view):
    """Fill the V_COLUMNS float32 of a drawn instance; returns whether anything can be said of its clusters."""
    m = f64_at(job[J_LENGTHS] + 8 * M_COLUMNS * drawn)
    c0 = m[5] * m[10] - m[6] * m[9], m[6] * m[8] - m[4] * m[10], m[4] * m[9] - m[5] * m[8]
    c1 = m[9] * m[2] - m[10] * m[1], m[10] * m[0] - m[8] * m[2], m[8] * m[1] - m[9] * m[0]
    c2 = m[1] * m[6] - m[2] * m[5], m[2] * m[4] - m[0] * m[6], m[0] * m[5] - m[1] * m[4]
    determinant = m[0] * c0[0] + m[1] * c0[1] + m[2] * c0[2]
    size = 0.0
    for k in range(12):
        if k % 4 != 3:
            size += m[k] * m[k]
    cofactors = 0.0
    far = 0.0
    for k in range(3):
        cofactors += c0[k] * c0[k] + c1[k] * c1[k] + c2[k] * c2[k]
        place = -(c0[k] * m[3] + c1[k] * m[7] + c2[k] * m[11]) / determinant
        view[V_EYE + k] = place
        far += abs(place)
    if not np.sqrt(size * cofactors) < _CONDITION * abs(determinant):
        return False
    fx, fy, cx, cy = lens[L_FX], lens[L_FY], lens[L_CX], lens[L_CY]
    # One pixel beyond the picture: a sample is at most half a pixel from its centre.
    for side in range(4):
        along, step, bound = 4 * (side >> 1), fx if side < 2 else fy, cx if side < 2 else cy
        if side & 1:
            step, bound = -step, (job[J_WIDTH] if side < 2 else job[J_HEIGHT]) - bound
        x = step * m[along] + (bound + 1.0) * m[8]
        y = step * m[along + 1] + (bound + 1.0) * m[9]
        z = step * m[along + 2] + (bound + 1.0) * m[10]
        length = np.sqrt(x * x + y * y + z * z)
        view[V_SIDES + 3 * side] = x / length
        view[V_SIDES + 3 * side + 1] = y / length
        view[V_SIDES + 3 * side + 2] = z / length
    stretch = 0.0  # no sum of a row of M^T M is below its greatest eigenvalue
    for i in range(3):
        total = 0.0
        for j in range(3):
            total += abs(m[i] * m[j] + m[4 + i] * m[4 + j] + m[8 + i] * m[8 + j])
        stretch = max(stretch, total)
    stretch = np.sqrt(stretch)
    for k in range(3):
        view[V_DEPTH + k] = m[8 + k]
    view[V_STEEPEST] = np.sqrt(m[8] * m[8] + m[9] * m[9] + m[10] * m[10])
    pixels = max(fx, fy) * stretch
    skew = fx * fy * abs(determinant) / (pixels * pixels * stretch)
    row = drawn * T_COLUMNS
    table = i64_at(job[J_TABLE])
    dropped = table[row + T_HIDDEN] != 0 or (table[row + T_CULL] != 0 and job[J_LISTS] == job[J_BANDS])
    view[V_STRETCH] = stretch
    view[V_PIXELS] = pixels
    view[V_SKEW] = skew if dropped else 0.0
    view[V_FAR] = far
    view[V_NEAR] = lens[L_NEAR]
    return True


@inner
def seen_clusters(clusters, view, at):
    """The bits of the clusters ``at .. at + 8``, a multiple of eight, of which something may be seen.

    Args:
        clusters: address of what ``bound_clusters`` has left. view: see ``look_at``.
    """
    own = f32_at(clusters + 4 * C_COLUMNS * at)
    x, y, z = vec.load(own, 0), vec.load(own, 8), vec.load(own, 16)
    slack = (vec.absolute(x) + vec.absolute(y) + vec.absolute(z) + vec.f32(view[V_FAR])) * vec.f32(_SLACK)
    reach = vec.load(own, 8 * C_RADIUS) + slack
    x, y, z = x - vec.f32(view[V_EYE]), y - vec.f32(view[V_EYE + 1]), z - vec.f32(view[V_EYE + 2])
    none = vec.f32(0.0)
    beyond = none - reach
    hidden = x != x
    for side in range(4):
        k = V_SIDES + 3 * side
        hidden = hidden | (x * vec.f32(view[k]) + y * vec.f32(view[k + 1]) + z * vec.f32(view[k + 2]) < beyond)
    across = x * vec.load(own, 8 * C_AXIS) + y * vec.load(own, 8 * C_AXIS + 8) + z * vec.load(own, 8 * C_AXIS + 16)
    square = x * x + y * y + z * z
    beside = vec.sqrt(vec.most(square - across * across, none) + square * vec.f32(1e-6))
    behind = across * vec.load(own, 8 * C_COSINE) - beside * vec.load(own, 8 * C_SINE)
    behind = behind + vec.load(own, 8 * C_OFFSET) - slack
    depth = x * vec.f32(view[V_DEPTH]) + y * vec.f32(view[V_DEPTH + 1]) + z * vec.f32(view[V_DEPTH + 2])
    deep = reach * vec.f32(view[V_STEEPEST])
    nearest, inverse = depth - deep, vec.f32(1.0) / (depth + deep)
    stretch = vec.f32(view[V_STRETCH])
    high = vec.load(own, 8 * C_HEIGHT) * vec.f32(view[V_PIXELS]) * inverse
    area = vec.f32(view[V_SKEW]) * high * (behind * stretch * inverse) * (nearest * inverse)
    # 1 + t, times the least depth.
    wide = nearest + stretch * (vec.sqrt(square) + reach)
    safe = area * nearest > vec.f32(_MOVED) * wide + vec.f32(_REST) * nearest
    # The eye's direction and a normal are least alike at the sum of two angles, which is beyond a half turn where the
    # axis does not point away: then the cone holds the direction to the eye.
    safe = safe & (across > none)
    hidden = hidden | (safe & (behind > none) & (nearest > vec.f32(view[V_NEAR])) & (high > vec.f32(_LOWEST)))
    return vec.bits(hidden) ^ 255
