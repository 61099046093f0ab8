"""Culling of clusters: sixteen neighbouring triangles that all face away from the camera or lie outside the image.

Each cluster has a bounding sphere of its corners and a cone of its normals. (Shirman, Abi-Ezzi: The cone of normals
technique for fast processing of curved patches, 1993.) Of most closed surfaces, more than half of the clusters are
culled, and their triangles are never read.

Triangle setup would have culled the same triangles, so the image does not change. Snapping to the grid must not turn a
culled triangle to the camera. That is so if its area on screen is large enough. Let

    F be the greater focal length, pixels,
    B the greatest factor by which the instance's pose stretches,
    k the skew of pose and lens: fx fy |det| = k F^2 B^3, where det is the determinant of the pose,
    h the least height of a triangle in the mesh's frame,
    K the least distance of the camera behind a triangle's plane, in the mesh's frame,
    z .. Z the range of depths,
    t the tangent of the angle to the optical axis,
    d the distance by which a coordinate moves, pixels.

Twice a triangle's area on screen is fx fy |det| n . (p - camera) / (z0 z1 z2), where n is as long as the longest edge
l times the height on it. No edge on screen is longer than F B l (1 + t) / z. Moving the corners changes twice the area
by at most 2 sqrt(2) d times the sum of two edges, plus 8 d^2. Hence, with e = h F B / Z, the sign cannot change if

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
"""Triangles of a cluster. More would wrap around small spheres; fewer would cost more to test than they save."""
MIN_TRIANGLES: Final = 64
"""Meshes with fewer triangles have no clusters, which would cost more than they save."""

# Clusters are stored in groups of eight, each value as eight float32: centre and radius of the sphere; axis, cosine and
# sine of the cone; the least height of a triangle (0: the cone is unknown); the least distance of the sphere's centre
# behind a triangle's plane.
C_CENTER: Final = 0
C_RADIUS: Final = 3
C_AXIS: Final = 4
C_COSINE: Final = 7
C_SINE: Final = 8
C_HEIGHT: Final = 9
C_DISTANCE: Final = 10
C_COLUMNS: Final = 11

VIEW: Final = Struct(
    "ClusterView",
    {
        "clusters": I64,  # address of the mesh's clusters; 0: none, or nothing can be culled
        "camera": array_of(F32, 3),  # position in the mesh's frame, as all that follows
        "sides": array_of(F32, 12),  # inward normals of the view frustum's four sides
        "depth_gradient": array_of(F32, 3),
        "depth_gradient_length": F32,
        "stretch": F32,  # B
        "pixel_stretch": F32,  # F B
        "skew": F32,  # k; 0: back faces are drawn
        "camera_l1": F32,  # sum of the absolute values of ``camera``
        "near": F32,  # near plane
    },
)
"""Camera of a draw, for culling its clusters. The letters are explained above."""

_SNAPPING: Final = 0.0172
"""4 sqrt(2) d with d = 1/512 pixel by snapping and 1/1024 by float32 within the guard band, with some margin."""
_MIN_HEIGHT: Final = 0.02
"""Pixels: e below which the cone is not used; above it 8 d^2 / e is below _SNAPPING_SQUARED."""
_SNAPPING_SQUARED: Final = 0.004
_ROUNDING: Final = 4e-6
"""Rounding error of a distance in float32, relative to the coordinates."""
_MAX_CONDITION: Final = 1e3
"""Maximum condition number of a pose: beyond it, nothing is culled."""


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
        offset = (cluster >> 3) * 8 * C_COLUMNS + (cluster & 7)
        begin, end = 3 * CLUSTER * cluster, 3 * min(CLUSTER * (cluster + 1), triangles)
        first = 3 * np.int64(indices[begin])
        min_x = max_x = np.float64(positions[first])
        min_y = max_y = np.float64(positions[first + 1])
        min_z = max_z = np.float64(positions[first + 2])
        ax = ay = az = 0.0
        plane_count, min_squared_height = 0, np.inf
        for k in range(begin, end, 3):
            a, b, c = 3 * np.int64(indices[k]), 3 * np.int64(indices[k + 1]), 3 * np.int64(indices[k + 2])
            x, y, z = np.float64(positions[a]), np.float64(positions[a + 1]), np.float64(positions[a + 2])
            x1, y1, z1 = np.float64(positions[b]), np.float64(positions[b + 1]), np.float64(positions[b + 2])
            x2, y2, z2 = np.float64(positions[c]), np.float64(positions[c + 1]), np.float64(positions[c + 2])
            min_x, max_x = min(min_x, x, x1, x2), max(max_x, x, x1, x2)
            min_y, max_y = min(min_y, y, y1, y2), max(max_y, y, y1, y2)
            min_z, max_z = min(min_z, z, z1, z2), max(max_z, z, z1, z2)
            ux, uy, uz, vx, vy, vz = x1 - x, y1 - y, z1 - z, x2 - x, y2 - y, z2 - z
            wx, wy, wz = x2 - x1, y2 - y1, z2 - z1
            uu, vv, ww = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz, wx * wx + wy * wy + wz * wz
            if uu == 0.0 or vv == 0.0 or ww == 0.0:
                continue  # degenerate: never visible
            nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            nn = nx * nx + ny * ny + nz * nz
            min_squared_height = min(min_squared_height, nn / max(uu, vv, ww))
            scale = 1.0 / np.sqrt(nn)
            nx, ny, nz = nx * scale, ny * scale, nz * scale
            planes[4 * plane_count], planes[4 * plane_count + 1], planes[4 * plane_count + 2] = nx, ny, nz
            planes[4 * plane_count + 3] = nx * x + ny * y + nz * z
            plane_count += 1
            ax, ay, az = ax + nx, ay + ny, az + nz
        mx = np.float32(0.5 * (min_x + max_x))
        my = np.float32(0.5 * (min_y + max_y))
        mz = np.float32(0.5 * (min_z + max_z))
        rx, ry, rz = max(max_x - mx, mx - min_x), max(max_y - my, my - min_y), max(max_z - mz, mz - min_z)
        radius = np.sqrt(rx * rx + ry * ry + rz * rz)
        length = np.sqrt(ax * ax + ay * ay + az * az)
        cosine, distance = 1.0, np.inf
        for k in range(plane_count):
            nx, ny, nz = planes[4 * k], planes[4 * k + 1], planes[4 * k + 2]
            cosine = min(cosine, (nx * ax + ny * ay + nz * az) / length)
            distance = min(distance, planes[4 * k + 3] - (nx * mx + ny * my + nz * mz))
        cosine -= 1e-6
        # Non-finite values fail all comparisons, here and later.
        has_cone = plane_count > 0 and length > 0.0 and cosine > 0.0 and min_squared_height > 0.0
        out[offset] = mx
        out[offset + 8] = my
        out[offset + 16] = mz
        out[offset + 8 * C_RADIUS] = radius * 1.000001
        if has_cone:
            out[offset + 8 * C_AXIS] = ax / length
            out[offset + 8 * C_AXIS + 8] = ay / length
            out[offset + 8 * C_AXIS + 16] = az / length
            out[offset + 8 * C_COSINE] = cosine
            out[offset + 8 * C_SINE] = np.sqrt(max(1.0 - cosine * cosine, 0.0)) + 1e-6
            out[offset + 8 * C_HEIGHT] = np.sqrt(min_squared_height) * 0.999999
            out[offset + 8 * C_DISTANCE] = distance - 1e-6 * radius


@device_function
def view_clusters(frame, draw, view):
    """Fill the view of a draw for ``visible_clusters``; ``view.clusters`` is 0 if nothing can be culled."""
    view.clusters = draw.clusters
    if draw.clusters == 0:
        return
    m = draw.X_camera_mesh
    # Rows of cofactors.
    c0 = m[5] * m[10] - m[6] * m[9], m[6] * m[8] - m[4] * m[10], m[4] * m[9] - m[5] * m[8]
    c1 = m[9] * m[2] - m[10] * m[1], m[10] * m[0] - m[8] * m[2], m[8] * m[1] - m[9] * m[0]
    c2 = m[1] * m[6] - m[2] * m[5], m[2] * m[4] - m[0] * m[6], m[0] * m[5] - m[1] * m[4]
    determinant = m[0] * c0[0] + m[1] * c0[1] + m[2] * c0[2]
    squared_norm = 0.0
    for k in range(12):
        if k % 4 != 3:
            squared_norm += m[k] * m[k]
    squared_cofactors = 0.0
    camera_l1 = 0.0
    for k in range(3):
        squared_cofactors += c0[k] * c0[k] + c1[k] * c1[k] + c2[k] * c2[k]
        coordinate = -(c0[k] * m[3] + c1[k] * m[7] + c2[k] * m[11]) / determinant
        view.camera[k] = coordinate
        camera_l1 += abs(coordinate)
    if not np.sqrt(squared_norm * squared_cofactors) < _MAX_CONDITION * abs(determinant):
        view.clusters = 0
        return
    fx, fy = frame.fx, frame.fy
    # One pixel beyond the image: a sample is at most half a pixel from its centre.
    for side in range(4):
        m_row, focal, center = 4 * (side >> 1), fx if side < 2 else fy, frame.cx if side < 2 else frame.cy
        if side & 1:
            focal, center = -focal, (frame.width if side < 2 else frame.height) - center
        x = focal * m[m_row] + (center + 1.0) * m[8]
        y = focal * m[m_row + 1] + (center + 1.0) * m[9]
        z = focal * m[m_row + 2] + (center + 1.0) * m[10]
        length = np.sqrt(x * x + y * y + z * z)
        view.sides[3 * side] = x / length
        view.sides[3 * side + 1] = y / length
        view.sides[3 * side + 2] = z / length
    stretch = 0.0  # the greatest row sum of M^T M bounds its greatest eigenvalue
    for i in range(3):
        row_sum = 0.0
        for j in range(3):
            row_sum += abs(m[i] * m[j] + m[4 + i] * m[4 + j] + m[8 + i] * m[8 + j])
        stretch = max(stretch, row_sum)
    stretch = np.sqrt(stretch)
    for k in range(3):
        view.depth_gradient[k] = m[8 + k]
    view.depth_gradient_length = np.sqrt(m[8] * m[8] + m[9] * m[9] + m[10] * m[10])
    pixel_stretch = max(fx, fy) * stretch
    skew = fx * fy * abs(determinant) / (pixel_stretch * pixel_stretch * stretch)
    culls_back_faces = draw.hidden_sign != 0 or (draw.culled_sign != 0 and frame.bin_count == frame.band_count)
    view.stretch = stretch
    view.pixel_stretch = pixel_stretch
    view.skew = skew if culls_back_faces else 0.0
    view.camera_l1 = camera_l1
    view.near = frame.near


@device_function
def visible_clusters(view, first):
    """Return a mask of those of the eight clusters from ``first`` on, a multiple of eight, that may be visible."""
    values = f32_at(view.clusters + 4 * C_COLUMNS * first)
    x, y, z = vec.load(values, 0), vec.load(values, 8), vec.load(values, 16)
    slack = (vec.absolute(x) + vec.absolute(y) + vec.absolute(z) + vec.f32(view.camera_l1)) * vec.f32(_ROUNDING)
    radius = vec.load(values, 8 * C_RADIUS) + slack
    x, y, z = x - vec.f32(view.camera[0]), y - vec.f32(view.camera[1]), z - vec.f32(view.camera[2])
    zero = vec.f32(0.0)
    is_hidden = x != x
    for side in range(4):
        k = 3 * side
        distance = x * vec.f32(view.sides[k]) + y * vec.f32(view.sides[k + 1]) + z * vec.f32(view.sides[k + 2])
        is_hidden = is_hidden | (distance < zero - radius)
    along_axis = (
        x * vec.load(values, 8 * C_AXIS) + y * vec.load(values, 8 * C_AXIS + 8) + z * vec.load(values, 8 * C_AXIS + 16)
    )
    squared_distance = x * x + y * y + z * z
    off_axis = vec.sqrt(
        vec.maximum(squared_distance - along_axis * along_axis, zero) + squared_distance * vec.f32(1e-6)
    )
    behind = along_axis * vec.load(values, 8 * C_COSINE) - off_axis * vec.load(values, 8 * C_SINE)
    behind = behind + vec.load(values, 8 * C_DISTANCE) - slack
    gradient = view.depth_gradient
    depth = x * vec.f32(gradient[0]) + y * vec.f32(gradient[1]) + z * vec.f32(gradient[2])
    depth_range = radius * vec.f32(view.depth_gradient_length)
    min_z, max_inv_z = depth - depth_range, vec.f32(1.0) / (depth + depth_range)
    stretch = vec.f32(view.stretch)
    height = vec.load(values, 8 * C_HEIGHT) * vec.f32(view.pixel_stretch) * max_inv_z
    area = vec.f32(view.skew) * height * (behind * stretch * max_inv_z) * (min_z * max_inv_z)
    # (1 + t) z.
    slant_z = min_z + stretch * (vec.sqrt(squared_distance) + radius)
    is_safe = area * min_z > vec.f32(_SNAPPING) * slant_z + vec.f32(_SNAPPING_SQUARED) * min_z
    # The angle between the camera's direction and a normal is at most that to the axis plus the cone's. Where the axis
    # does not point away, the sum may exceed a half turn: then the cone contains the direction to the camera.
    is_safe = is_safe & (along_axis > zero) & (behind > zero)
    is_hidden = is_hidden | (is_safe & (min_z > vec.f32(view.near)) & (height > vec.f32(_MIN_HEIGHT)))
    return vec.movemask(is_hidden) ^ 255
