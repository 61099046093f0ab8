"""Light of a projector at any pose, such as that of another camera, at every pixel of a camera image.

``projector`` computes the light of the camera's own projector. There, a surface point has the same row in both images.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F64, I64, Array1, Array2, Array3, f64
from renderers.shading.camera_light import MAX_FALLOFF, REFERENCE_DISTANCE
from renderers.stereo.light.projector import SHADOW_BIAS, pattern_at


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """Surfaces that a camera sees."""

    camera: Camera
    depth: NDArray[np.float32]
    """(H, W) float32, metres, +inf: background."""
    normal: NDArray[np.float32]
    """(H, W, 3) float32, unit normals in the camera's frame; 0: unlit (points, lines)."""
    returned: tuple[NDArray[np.int32], NDArray[np.float32]]
    """(H, W) int32 instances and (I,) float32 ``returned_shares`` of them."""
    light: NDArray[np.float32]
    """(H, W or more) float32, ``Frame.light``."""


def add_dots(
    light: NDArray[np.uint16],
    surfaces: Surfaces,
    projector: Camera,
    projector_depth: NDArray[np.float32],
    strength: float,
    *,
    soft: bool,
    right: bool,
) -> None:
    """Add a projector's light to an image of dots (``projected_dots``).

    Args:
        projector: camera at the projector; points outside its image are not lit.
        projector_depth: (h, w), depth seen from there, for shadows.
        strength: factor of the light.
        soft, right: as for ``pattern_at``.
    """
    camera = surfaces.camera
    X_projector_camera = np.ascontiguousarray((projector.X_camera_world @ camera.X_world_camera)[:3])
    pattern, cells_per_pixel = pattern_at(projector.fx, soft=soft, right=right)
    _add_dots(
        surfaces.depth, surfaces.normal, np.array((camera.fx, camera.fy, camera.cx, camera.cy)), X_projector_camera,
        projector_depth, np.array((projector.fx, projector.fy, projector.cx, projector.cy)), pattern,
        cells_per_pixel, float(strength), *surfaces.returned, surfaces.light, light,
    )  # fmt: skip


@kernel
def _add_dots(
    depth: Array2[np.float32],
    normal: Array3[np.float32],
    k: Array1[np.float64],
    X_projector_camera: Array2[np.float64],
    projector_depth: Array2[np.float32],
    projector_k: Array1[np.float64],
    pattern: Array2[np.uint8],
    cells_per_pixel: F64,
    strength: F64,
    ids: Array2[np.int32],
    shares: Array1[np.float32],
    other_light: Array2[np.float32],
    light: Array2[np.uint16],
) -> None:
    """Add the projector's light at every pixel. Arguments that are not listed are those of ``add_dots``.

    Each pixel's surface point is transformed to the projector's frame and projected to its image, which gives the place
    in the pattern. The point is lit unless a nearer surface is there.

    Args:
        k, projector_k: fx, fy, cx, cy of the camera and of the projector.
        pattern: (N, N); N is a power of two.
        cells_per_pixel: cells of the pattern per pixel of the projector's image.
        ids: (H, W), instance at every pixel.
        shares: (I,), share of the light that each instance returns.
        other_light: (H, W or more), the surfaces' other light, which dots are relative to.
    """
    height, width = depth.shape
    rows, columns = projector_depth.shape
    center = pattern.shape[0] // 2
    R, t = X_projector_camera[:, :3], X_projector_camera[:, 3]
    origin = np.empty(3)  # position of the projector in the camera's frame
    for axis in range(3):
        origin[axis] = -(R[0, axis] * t[0] + R[1, axis] * t[1] + R[2, axis] * t[2])
    for row in range(height):
        for column in range(width):
            z = f64(depth[row, column])
            if not z < np.inf:
                continue
            x, y = (column + 0.5 - k[2]) / k[0] * z, (row + 0.5 - k[3]) / k[1] * z
            projector_z = R[2, 0] * x + R[2, 1] * y + R[2, 2] * z + t[2]
            if projector_z <= 0.0:
                continue
            # Pixels from the principal point of the projector's image.
            offset_x = projector_k[0] * (R[0, 0] * x + R[0, 1] * y + R[0, 2] * z + t[0]) / projector_z
            offset_y = projector_k[1] * (R[1, 0] * x + R[1, 1] * y + R[1, 2] * z + t[1]) / projector_z
            # Upper left of the four pixels around the point.
            left = int(np.floor(offset_x + projector_k[2] - 0.5))
            top = int(np.floor(offset_y + projector_k[3] - 0.5))
            if left < 0 or top < 0 or left >= columns - 1 or top >= rows - 1:
                continue
            if _is_in_shadow(projector_depth, left, top, projector_z):
                continue
            value = _interpolated(pattern, offset_x * cells_per_pixel + center, offset_y * cells_per_pixel + center)
            to_x, to_y, to_z = origin[0] - x, origin[1] - y, origin[2] - z
            distance_squared = to_x * to_x + to_y * to_y + to_z * to_z
            n_x, n_y, n_z = normal[row, column, 0], normal[row, column, 1], normal[row, column, 2]
            if n_x != 0.0 or n_y != 0.0 or n_z != 0.0:  # not an unlit surface
                value *= max((n_x * to_x + n_y * to_y + n_z * to_z) / np.sqrt(distance_squared), 0.0)
            falloff = min(REFERENCE_DISTANCE**2 / distance_squared, MAX_FALLOFF)
            value *= falloff * strength * shares[max(ids[row, column], 0)] / other_light[row, column]
            light[row, column] = int(min(light[row, column] + value + 0.5, 65535.0))


@inlined
def _is_in_shadow(projector_depth: Array2[np.float32], left: I64, top: I64, projector_z: F64) -> bool:
    """Return True if all four pixels from ``left`` and ``top`` on are nearer than a point at depth ``projector_z``."""
    farthest = max(
        max(projector_depth[top, left], projector_depth[top, left + 1]),
        max(projector_depth[top + 1, left], projector_depth[top + 1, left + 1]),
    )
    return farthest < projector_z * (1.0 - SHADOW_BIAS)


@inlined
def _interpolated(pattern: Array2[np.uint8], u: F64, v: F64) -> F64:
    """Return the bilinearly interpolated pattern, which repeats, at column ``u`` and row ``v``."""
    mask = pattern.shape[0] - 1
    cell_u, cell_v = int(np.floor(u)), int(np.floor(v))
    fraction_u, fraction_v = u - cell_u, v - cell_v
    upper, lower = pattern[cell_v & mask], pattern[(cell_v + 1) & mask]
    left, right = cell_u & mask, (cell_u + 1) & mask
    value = (upper[left] * (1.0 - fraction_u) + upper[right] * fraction_u) * (1.0 - fraction_v)
    value += (lower[left] * (1.0 - fraction_u) + lower[right] * fraction_u) * fraction_v
    return value
