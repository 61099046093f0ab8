"""Culling of clusters: sixteen neighbouring triangles that all face away from the camera or lie outside the image.

Each cluster has a bounding sphere of its corners and a cone of its normals. (Shirman, Abi-Ezzi: The cone of normals
technique for fast processing of curved patches, 1993.) More than half of the clusters of most closed surfaces are
skipped without a look at their triangles.

Triangle setup would have culled the same triangles, so the image does not change. A triangle that faces away might
still turn to the camera when its corners are snapped to the grid. Let F be the greater focal length in pixels, B the
greatest factor by which the instance's pose stretches, h the least height of a triangle in the mesh's frame and K the
least distance of the camera behind a triangle's plane; fx fy |det| = k F^2 B^3; z .. Z the range of depths. Twice a
triangle's area on screen is fx fy |det| n . (p - camera) / (z0 z1 z2), where n is as long as the longest edge l times
the height on it, and no edge on screen is longer than F B l (1 + t) / z, where t is the tangent of the angle to the
optical axis. Corners that move by d each way change twice the area by at most 2 sqrt(2) d times the sum of two edges,
plus 8 d^2. Hence, with e = h F B / Z, the sign cannot change if

    k e (K B / Z) (z / Z) > 4 sqrt(2) d (1 + t) + 8 d^2 / e
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import device_function
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_calls import is_set
from renderers.compiler.pointers import f32_at, stack_array, u32_at
from renderers.compiler.structs import F32, I64, Struct, array_of

SHIFT: Final = 4
CLUSTER: Final = 1 << SHIFT
"""Triangles of a cluster: enough to save more than testing it costs, few enough to be less than a row of a sphere."""
MIN_TRIANGLES: Final = 64
"""Triangles of a mesh below which clusters cost more than they save."""

# Clusters are stored by eights, each value as eight float32: centre and radius of the sphere; axis, cosine and sine of
# the cone; the least height of a triangle (0: the cone is unknown); how far the centre lies behind all planes at least.
C_CENTER: Final = 0
C_RADIUS: Final = 3
C_AXIS: Final = 4
C_COSINE: Final = 7
C_SINE: Final = 8
C_HEIGHT: Final = 9
C_OFFSET: Final = 10
C_COLUMNS: Final = 11

VIEW: Final = Struct(
    "ClusterView",
    {
        "clusters": I64,  # address of the mesh's clusters; 0: none, or nothing can be culled
        "camera": array_of(F32, 3),  # position in the mesh's frame, as all that follows
        "sides": array_of(F32, 12),  # inward normals of the view frustum's four sides
        "depth": array_of(F32, 3),  # gradient of the depth
        "steepest": F32,  # its length
        "stretch": F32,  # B
        "pixels": F32,  # F B
        "skew": F32,  # k; 0: back faces are drawn
        "far": F32,  # sum of the absolute values of ``camera``
        "near": F32,  # near plane
    },
)
"""What culling clusters of a draw needs; see the module's text for the letters."""

_SNAPPING: Final = 0.0172
"""4 sqrt(2) d with d = 1/512 pixel by snapping and 1/1024 by float32 within the guard band, with some margin."""
_MIN_HEIGHT: Final = 0.02
"""Pixels: e below which the cone is not used; above it 8 d^2 / e is below _SNAPPING_SQUARED."""
_SNAPPING_SQUARED: Final = 0.004
_ROUNDING: Final = 4e-6
"""Loss of a distance in float32, relative to the coordinates."""
_MAX_CONDITION: Final = 1e3


_plane_array = stack_array(types.float64, 4 * CLUSTER)


def cluster_values(triangles: int) -> int:
    """Return the number of float32 that ``bound_clusters`` fills for a mesh."""
    return -(-triangles // (8 * CLUSTER)) * 8 * C_COLUMNS


@kernel("void(int64, int64, int64, int64, int64)")
def bound_clusters(positions_at, indices_at, triangles, out_at, stop_at):
    """Compute spheres and cones of a mesh's clusters.

    Args:
        positions_at, indices_at, triangles: the mesh, float32 and uint32.
        out_at: address of ``cluster_values(triangles)`` zeroed float32.
        stop_at: address of a ``StopFlag``; the result is incomplete if it was set.
    """
    positions, indices, out = f32_at(positions_at), u32_at(indices_at), f32_at(out_at)
    planes = _plane_array()
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
                continue  # degenerate: never visible
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            nn = nx * nx + ny * ny + nz * nz
            height = min(height, nn / max(uu, vv, ww))
            scale = 1.0 / np.sqrt(nn)
            nx, ny, nz = nx * scale, ny * scale, nz * scale
            planes[4 * known], planes[4 * known + 1], planes[4 * known + 2] = nx, ny, nz
            planes[4 * known + 3] = nx * x + ny * y + nz * z
            known += 1
            ax, ay, az = ax + nx, ay + ny, az + nz
        mx, my, mz = np.float32(0.5 * (lx + hx)), np.float32(0.5 * (ly + hy)), np.float32(0.5 * (lz + hz))
        rx, ry, rz = max(hx - mx, mx - lx), max(hy - my, my - ly), max(hz - mz, mz - lz)
        radius = np.sqrt(rx * rx + ry * ry + rz * rz)
        length = np.sqrt(ax * ax + ay * ay + az * az)
        cosine, offset = 1.0, np.inf
        for k in range(known):
            nx, ny, nz = planes[4 * k], planes[4 * k + 1], planes[4 * k + 2]
            cosine = min(cosine, (nx * ax + ny * ay + nz * az) / length)
            offset = min(offset, planes[4 * k + 3] - (nx * mx + ny * my + nz * mz))
        cosine -= 1e-6
        # Non-finite values fail all comparisons, here and later.
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


@device_function
def view_clusters(frame, draw, view):
    """Fill the view of a draw for ``visible_clusters``; ``view.clusters`` is 0 if nothing can be culled."""
    view.clusters = draw.clusters
    if draw.clusters == 0:
        return
    m = draw.X_camera_mesh
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
        coordinate = -(c0[k] * m[3] + c1[k] * m[7] + c2[k] * m[11]) / determinant
        view.camera[k] = coordinate
        far += abs(coordinate)
    if not np.sqrt(size * cofactors) < _MAX_CONDITION * abs(determinant):
        view.clusters = 0
        return
    fx, fy = frame.fx, frame.fy
    # One pixel beyond the image: a sample is at most half a pixel from its centre.
    for side in range(4):
        along, step, limit = 4 * (side >> 1), fx if side < 2 else fy, frame.cx if side < 2 else frame.cy
        if side & 1:
            step, limit = -step, (frame.width if side < 2 else frame.height) - limit
        x = step * m[along] + (limit + 1.0) * m[8]
        y = step * m[along + 1] + (limit + 1.0) * m[9]
        z = step * m[along + 2] + (limit + 1.0) * m[10]
        length = np.sqrt(x * x + y * y + z * z)
        view.sides[3 * side] = x / length
        view.sides[3 * side + 1] = y / length
        view.sides[3 * side + 2] = z / length
    stretch = 0.0  # the greatest row sum of M^T M bounds its greatest eigenvalue
    for i in range(3):
        total = 0.0
        for j in range(3):
            total += abs(m[i] * m[j] + m[4 + i] * m[4 + j] + m[8 + i] * m[8 + j])
        stretch = max(stretch, total)
    stretch = np.sqrt(stretch)
    for k in range(3):
        view.depth[k] = m[8 + k]
    view.steepest = np.sqrt(m[8] * m[8] + m[9] * m[9] + m[10] * m[10])
    pixels = max(fx, fy) * stretch
    skew = fx * fy * abs(determinant) / (pixels * pixels * stretch)
    dropped = draw.hidden != 0 or (draw.culled != 0 and frame.bin_count == frame.band_count)
    view.stretch = stretch
    view.pixels = pixels
    view.skew = skew if dropped else 0.0
    view.far = far
    view.near = frame.near


@device_function
def visible_clusters(view, at):
    """Return a mask of those of the eight clusters from ``at`` on, a multiple of eight, that may be visible."""
    own = f32_at(view.clusters + 4 * C_COLUMNS * at)
    x, y, z = vec.load(own, 0), vec.load(own, 8), vec.load(own, 16)
    slack = (vec.absolute(x) + vec.absolute(y) + vec.absolute(z) + vec.f32(view.far)) * vec.f32(_ROUNDING)
    reach = vec.load(own, 8 * C_RADIUS) + slack
    x, y, z = x - vec.f32(view.camera[0]), y - vec.f32(view.camera[1]), z - vec.f32(view.camera[2])
    none = vec.f32(0.0)
    beyond = none - reach
    hidden = x != x
    for side in range(4):
        k = 3 * side
        distance = x * vec.f32(view.sides[k]) + y * vec.f32(view.sides[k + 1]) + z * vec.f32(view.sides[k + 2])
        hidden = hidden | (distance < beyond)
    across = x * vec.load(own, 8 * C_AXIS) + y * vec.load(own, 8 * C_AXIS + 8) + z * vec.load(own, 8 * C_AXIS + 16)
    square = x * x + y * y + z * z
    beside = vec.sqrt(vec.maximum(square - across * across, none) + square * vec.f32(1e-6))
    behind = across * vec.load(own, 8 * C_COSINE) - beside * vec.load(own, 8 * C_SINE)
    behind = behind + vec.load(own, 8 * C_OFFSET) - slack
    depth = x * vec.f32(view.depth[0]) + y * vec.f32(view.depth[1]) + z * vec.f32(view.depth[2])
    deep = reach * vec.f32(view.steepest)
    nearest, inverse = depth - deep, vec.f32(1.0) / (depth + deep)
    stretch = vec.f32(view.stretch)
    high = vec.load(own, 8 * C_HEIGHT) * vec.f32(view.pixels) * inverse
    area = vec.f32(view.skew) * high * (behind * stretch * inverse) * (nearest * inverse)
    # 1 + t, times the least depth.
    wide = nearest + stretch * (vec.sqrt(square) + reach)
    safe = area * nearest > vec.f32(_SNAPPING) * wide + vec.f32(_SNAPPING_SQUARED) * nearest
    # The angle between the camera's direction and a normal is at most the sum of two angles. Where the axis does not
    # point away, the sum may exceed a half turn: then the cone holds the direction to the camera.
    safe = safe & (across > none)
    hidden = hidden | (safe & (behind > none) & (nearest > vec.f32(view.near)) & (high > vec.f32(_MIN_HEIGHT)))
    return vec.movemask(hidden) ^ 255
