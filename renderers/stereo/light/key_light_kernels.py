"""Kernel of ``key_light``: factors from the headlight to key light and sky."""

from __future__ import annotations

from typing import Final

import numpy as np

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel

FACTOR_ONE: Final = 64
"""Value of the factor 1."""
_MIN_COSINE: Final = 0.3
"""Minimum cosine of the headlight: factors would be noisy on surfaces that it hardly lights."""


@inlined
def _lit_share(shadow_depth, u, v, z):
    """Return the share of a light that reaches a point, from four texels with bilinear weights; 1 outside of the map.

    Args:
        shadow_depth: (S, S) float32, metres, +inf: nothing.
        u, v: position in the map, texels, float32.
        z: depth of the point, metres, float32.
    """
    last = np.float32(shadow_depth.shape[0] - 1)
    one = np.float32(1.0)
    u, v = u - np.float32(0.5), v - np.float32(0.5)
    if not (np.float32(0.0) < u < last and np.float32(0.0) < v < last):
        return one
    i, j = np.int64(u), np.int64(v)
    fu, fv = u - np.float32(i), v - np.float32(j)
    upper = np.float32(shadow_depth[j, i] >= z) * (one - fu) + np.float32(shadow_depth[j, i + 1] >= z) * fu
    lower = np.float32(shadow_depth[j + 1, i] >= z) * (one - fu) + np.float32(shadow_depth[j + 1, i + 1] >= z) * fu
    return upper * (one - fv) + lower * fv


@inlined
def _row_times_point(X, row, x, y, z):
    """Return one coordinate of a point, transformed by a (3, 4) matrix."""
    return X[row, 0] * x + X[row, 1] * y + X[row, 2] * z + X[row, 3]


@inlined
def _unshadowed_share(shadow_depth, shadow_map, X_light_camera, point, normal, n_l):
    """Return the share of the key light that reaches a point.

    Args:
        shadow_depth, shadow_map, X_light_camera: as for ``factor_rows``.
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
    return _lit_share(
        shadow_depth,
        np.float32(light_x * scale + center),
        np.float32(light_y * scale + center),
        np.float32(light_z - bias),
    )


@kernel(
    "void(float32[:,::1], float32[:,:,::1], float64[::1], float32[:,::1], float64[:,::1], float64[::1], float64[::1], "
    "float64[::1], float64[::1], uint8[:,::1])"
)
def factor_rows(
    depth, normal, intrinsics, shadow_depth, X_light_camera, shadow_map, to_light, up, light_levels, factors
):
    """Write the factors of ``key_light.light_factors``.

    Args:
        depth: (H, W) float32, metres, +inf: background.
        normal: (H, W, 3) float32, unit normals in the camera's frame, or 0.
        intrinsics: (4,) float64: fx, fy, cx, cy of the camera, pixels.
        shadow_depth: (S, S) float32, metres, +inf: nothing.
        X_light_camera: (3, 4) float64, from the camera's frame to the light's.
        shadow_map: (3,) float64: focal length and principal point, texels; offset of a point along its normal, metres
            per metre of distance from the light.
        to_light: (3,) float64, unit vector to the light in the camera's frame.
        up: (3,) float64, the world's z axis in the camera's frame.
        light_levels: (3,) float64: ``KEY_LIGHT``, ``SKY_LIGHT`` and ``GROUND_LIGHT``.
        factors: (H, W) uint8, output.
    """
    height, width = depth.shape
    inv_fx, inv_fy, cx, cy = 1.0 / intrinsics[0], 1.0 / intrinsics[1], intrinsics[2], intrinsics[3]
    key, sky, ground = light_levels[0], light_levels[1], light_levels[2]
    for row in range(height):
        ray_y = (row + 0.5 - cy) * inv_fy
        for column in range(width):
            z = float(depth[row, column])
            if not z < np.inf:
                factors[row, column] = FACTOR_ONE
                continue
            nx, ny, nz = float(normal[row, column, 0]), float(normal[row, column, 1]), float(normal[row, column, 2])
            headlight = -nz
            n_l = nx * to_light[0] + ny * to_light[1] + nz * to_light[2]
            n_up = nx * up[0] + ny * up[1] + nz * up[2]
            if nx == 0.0 and ny == 0.0 and nz == 0.0:  # unlit: as a surface that faces the camera and the sky
                headlight, n_l, n_up = 1.0, 0.8, 1.0
            share = np.float32(0.0)
            if n_l > 0.0:
                point = (column + 0.5 - cx) * inv_fx * z, ray_y * z, z
                share = _unshadowed_share(shadow_depth, shadow_map, X_light_camera, point, (nx, ny, nz), n_l)
            light_here = key * share * max(n_l, 0.0) + ground + (sky - ground) * (0.5 + 0.5 * n_up)
            factor = light_here / max(headlight, _MIN_COSINE) * FACTOR_ONE
            factors[row, column] = int(min(factor + 0.5, 255.0))
