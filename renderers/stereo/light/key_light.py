"""Key light with soft shadows, as factors of an image that was rendered under all other light.

The key light and the fit of its shadow map are those of the ``studio`` look (``renderers.shading.studio.shadows``).
Factors have half the image's resolution, because they are smooth except at the edges of objects. They cost 18 ms of CPU
time for an image of the demo scene; the look itself costs 43 ms.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F32, F64, I64, Array1, Array2, Array3, f32, i64
from renderers.light_rig import STUDIO
from renderers.shading.studio.shadows import light_camera, metres_per_pixel

FACTOR_ONE: Final = 64
"""Value of the factor 1, which leaves the light as it is."""
MAX_SHADOW_SIDE: Final = 512
"""Maximum side of the shadow map, texels: a quarter of the ``studio`` look's. Large texels make edges soft, about four
pixels at full resolution, with 4 samples instead of 25."""
_NORMAL_OFFSET: Final = 1.5
"""Offset of points along their normal, against self-shadowing, texels."""
_FIT_STEP: Final = 8
"""Pixels between the points that the shadow map is fitted to."""
_MAX_DEPTH_RATIO: Final = 1.5
"""Maximum depth of the points that the shadow map is fitted to, relative to the third quartile of the depths: a few far
points would make its texels large."""


def shadow_camera(depth: NDArray[np.float32], camera: Camera) -> Camera | None:
    """Return the camera of the shadow map, which looks along the key light; None if no point is visible.

    Args:
        depth: (H, W) float32, metres, +inf: background.
        camera: camera of ``depth``.
    """
    start = _FIT_STEP // 2
    z = depth[start::_FIT_STEP, start::_FIT_STEP].astype(np.float64)
    rows, columns = np.nonzero(np.isfinite(z))
    if not rows.size:
        return None
    z = z[rows, columns]
    x = (columns * _FIT_STEP + start + 0.5 - camera.cx) / camera.fx * z
    y = (rows * _FIT_STEP + start + 0.5 - camera.cy) / camera.fy * z
    near = z <= _MAX_DEPTH_RATIO * np.quantile(z, 0.75)
    points = np.stack((x, y, z), axis=-1)[near] @ camera.X_world_camera[:3, :3].T + camera.X_world_camera[:3, 3]
    return light_camera(STUDIO.lights[0], points, MAX_SHADOW_SIDE, metres_per_pixel(points, camera))


def light_factors(
    depth: NDArray[np.float32],
    normal: NDArray[np.float32],
    camera: Camera,
    shadow_depth: NDArray[np.float32],
    light: Camera,
    scene_light: NDArray[np.float32],
    key_light: float,
) -> NDArray[np.uint8]:
    """Return the factor by which the key light brightens each pixel, (H, W) uint8, units of 1/``FACTOR_ONE``.

    With n the surface's normal, l the direction to the key light, and s the share of it that reaches the surface, the
    key light adds ``key_light s max(n . l, 0)`` to the other light, ``scene_light``. The factor of background is 1.

    Args:
        depth: (H, W) float32, metres, +inf: background.
        normal: (H, W, 3) float32, unit normals in the camera's frame; 0: unlit (points, lines).
        camera: camera of ``depth`` and ``normal``.
        shadow_depth: (S, S) float32 depth seen by the light, metres, +inf: nothing.
        light: camera of ``shadow_depth``, by ``shadow_camera``.
        scene_light: (H, W) float32, all other light.
        key_light: light on a surface that faces the key light.
    """
    factors = np.empty(depth.shape, np.uint8)
    X_light_camera = light.X_camera_world @ camera.X_world_camera
    to_light = -X_light_camera[2, :3]  # one direction for all points: the light is far away
    offset = _NORMAL_OFFSET / light.fx  # per metre of distance from the light
    _write_factors(
        depth, normal, np.array((camera.fx, camera.fy, camera.cx, camera.cy)), shadow_depth,
        np.ascontiguousarray(X_light_camera[:3]), np.array((light.fx, light.cx, offset)),
        np.ascontiguousarray(to_light), scene_light, float(key_light), factors,
    )  # fmt: skip
    return factors


@inlined
def _lit_share(shadow_depth: Array2[np.float32], u: F32, v: F32, z: F32) -> F32:
    """Return the share of a light that reaches a point, from four texels with bilinear weights; 1 outside of the map.

    Args:
        shadow_depth: (S, S), metres, +inf: nothing.
        u, v: position in the map, texels.
        z: depth of the point, metres.
    """
    last = f32(shadow_depth.shape[0] - 1)
    one = f32(1.0)
    u, v = u - f32(0.5), v - f32(0.5)
    if not (f32(0.0) < u < last and f32(0.0) < v < last):
        return one
    i, j = i64(u), i64(v)
    fu, fv = u - f32(i), v - f32(j)
    upper = f32(shadow_depth[j, i] >= z) * (one - fu) + f32(shadow_depth[j, i + 1] >= z) * fu
    lower = f32(shadow_depth[j + 1, i] >= z) * (one - fu) + f32(shadow_depth[j + 1, i + 1] >= z) * fu
    return upper * (one - fv) + lower * fv


@inlined
def _row_times_point(X: Array2[np.float64], row: I64, x: F64, y: F64, z: F64) -> F64:
    """Return one coordinate of a point, transformed by a (3, 4) matrix."""
    return X[row, 0] * x + X[row, 1] * y + X[row, 2] * z + X[row, 3]


@inlined
def _unshadowed_share(
    shadow_depth: Array2[np.float32],
    shadow_map: Array1[np.float64],
    X_light_camera: Array2[np.float64],
    point: tuple[F64, F64, F32],
    normal: tuple[F32, F32, F32],
    n_l: F64,
) -> F32:
    """Return the share of the key light that reaches a point.

    Args:
        shadow_depth, shadow_map, X_light_camera: as for ``_write_factors``.
        point, normal: in the camera's frame; three float64 each.
        n_l: cosine of the light, above 0.
    """
    focal_length, center, normal_offset = shadow_map[0], shadow_map[1], shadow_map[2]
    offset = normal_offset * _row_times_point(X_light_camera, 2, point[0], point[1], point[2])
    x, y, z = point[0] + offset * normal[0], point[1] + offset * normal[1], point[2] + offset * normal[2]
    light_x, light_y = _row_times_point(X_light_camera, 0, x, y, z), _row_times_point(X_light_camera, 1, x, y, z)
    light_z = _row_times_point(X_light_camera, 2, x, y, z)
    scale = focal_length / light_z
    # A texel has one depth, but the depths of a slanted surface differ within it.
    bias = 0.5 * offset / max(n_l, 0.2)
    return _lit_share(shadow_depth, f32(light_x * scale + center), f32(light_y * scale + center), f32(light_z - bias))


@kernel
def _write_factors(
    depth: Array2[np.float32],
    normal: Array3[np.float32],
    intrinsics: Array1[np.float64],
    shadow_depth: Array2[np.float32],
    X_light_camera: Array2[np.float64],
    shadow_map: Array1[np.float64],
    to_light: Array1[np.float64],
    scene_light: Array2[np.float32],
    key_light: F64,
    factors: Array2[np.uint8],
) -> None:
    """Write ``light_factors`` to ``factors``.

    Args:
        intrinsics: (4,): fx, fy, cx, cy of the camera, pixels.
        X_light_camera: (3, 4), from the camera's frame to the light's.
        shadow_map: (3,): focal length and principal point, texels; offset of a point along its normal, metres
            per metre of distance from the light.
        to_light: (3,), unit vector to the light in the camera's frame.
    """
    height, width = depth.shape
    inv_fx, inv_fy, cx, cy = 1.0 / intrinsics[0], 1.0 / intrinsics[1], intrinsics[2], intrinsics[3]
    for row in range(height):
        ray_y = (row + 0.5 - cy) * inv_fy
        for column in range(width):
            z = float(depth[row, column])
            if not z < np.inf:
                factors[row, column] = FACTOR_ONE
                continue
            nx, ny, nz = float(normal[row, column, 0]), float(normal[row, column, 1]), float(normal[row, column, 2])
            n_l = nx * to_light[0] + ny * to_light[1] + nz * to_light[2]
            if nx == 0.0 and ny == 0.0 and nz == 0.0:  # unlit
                factors[row, column] = FACTOR_ONE
                continue
            share = f32(0.0)
            if n_l > 0.0:
                point = (column + 0.5 - cx) * inv_fx * z, ray_y * z, z
                share = _unshadowed_share(shadow_depth, shadow_map, X_light_camera, point, (nx, ny, nz), n_l)
            factor = (1.0 + key_light * share * max(n_l, 0.0) / scene_light[row, column]) * FACTOR_ONE
            factors[row, column] = int(min(factor + 0.5, 255.0))
