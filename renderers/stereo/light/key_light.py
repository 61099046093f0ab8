"""Key light with soft shadows and light from the sky, as factors of an image that was rendered under the headlight.

The key light and the fit of its shadow map are those of the ``studio`` look (``renderers.shading.studio.shadows``).
Factors have half the image's resolution, because they are smooth except at the edges of objects. They cost 18 ms of CPU
time for an image of the demo scene; the look itself costs 43 ms.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.light_rig import STUDIO
from renderers.shading.studio.shadows import light_camera, metres_per_pixel
from renderers.stereo.light import key_light_kernels as kernels

FACTOR_ONE: Final = kernels.FACTOR_ONE
"""Value of the factor 1, which leaves the light as it is."""
KEY_LIGHT: Final = 0.8
"""Light of the key light on a surface that faces it, relative to the headlight on one that faces the camera."""
SKY_LIGHT: Final = 0.5
"""Light of the sky on a surface that faces up, in the same unit."""
GROUND_LIGHT: Final = 0.25
"""Light from below on a surface that faces down, in the same unit."""
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
) -> NDArray[np.uint8]:
    """Return the factor from the headlight to key light and sky at each pixel, (H, W) uint8, units of 1/``FACTOR_ONE``.

    With n the surface's normal, v the direction to the camera, l that to the key light, and s the share of the key
    light that reaches the surface: the light is ``max(n . v, 0.3)`` under the headlight. It becomes
    ``KEY_LIGHT s max(n . l, 0)`` plus light between ``GROUND_LIGHT`` and ``SKY_LIGHT``. The factor of background is 1.

    Args:
        depth: (H, W) float32, metres, +inf: background.
        normal: (H, W, 3) float32, unit normals in the camera's frame; 0: unlit (points, lines).
        camera: camera of ``depth`` and ``normal``.
        shadow_depth: (S, S) float32 depth seen by the light, metres, +inf: nothing.
        light: camera of ``shadow_depth``, by ``shadow_camera``.
    """
    factors = np.empty(depth.shape, np.uint8)
    X_light_camera = light.X_camera_world @ camera.X_world_camera
    to_light = -X_light_camera[2, :3]  # one direction for all points: the light is far away
    up = camera.X_world_camera[2, :3]
    offset = _NORMAL_OFFSET / light.fx  # per metre of distance from the light
    kernels.factor_rows(
        depth, normal, np.array((camera.fx, camera.fy, camera.cx, camera.cy)), shadow_depth,
        np.ascontiguousarray(X_light_camera[:3]), np.array((light.fx, light.cx, offset)),
        np.ascontiguousarray(to_light), np.ascontiguousarray(up), np.array((KEY_LIGHT, SKY_LIGHT, GROUND_LIGHT)),
        factors,
    )  # fmt: skip
    return factors
