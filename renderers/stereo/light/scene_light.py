"""Light that the lamp, the sky, the ground and further lights give to each pixel's surface (``shading.camera_light``).

A rendered image is the product of it and of what surfaces reflect. Light that is added to the image afterwards, a
projector's or the key light's, is divided by it.

The key light and the fit of its shadow map are those of the ``studio`` look (``renderers.shading.studio.shadows``).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler import simd as vec
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F64, I64, Address
from renderers.compiler.pointers import address_of, f32_at
from renderers.drawlist import Light, LightKind
from renderers.light_rig import STUDIO, CameraLight
from renderers.shading.camera_light import MIN_AMBIENT, CameraLightInputs, CameraLightJob, total_light
from renderers.shading.studio.shadows import light_camera, metres_per_pixel
from renderers.stereo.light.levels import LightLevels

_MIN_DISTANCE: Final = 1.0
"""Distance below which lights are not dimmed any further, metres."""
MAX_SHADOW_SIDE: Final = 512
"""Maximum side of the shadow map, texels: a quarter of the ``studio`` look's. Large texels make edges soft, about four
pixels at full resolution, with 4 samples instead of 25."""
NORMAL_OFFSET: Final = 1.5
"""Offset of points along their normal, against self-shadowing, texels."""
_FIT_STEP: Final = 2
"""Pixels between the points that the shadow map is fitted to."""
_TEXEL_PIXELS: Final = 2
"""Minimum size of a texel of the shadow map, pixels of the image."""
_MAX_DEPTH_RATIO: Final = 1.5
"""Maximum depth of the points that the shadow map is fitted to, relative to the third quartile of the depths: a few far
points would make its texels large."""


def camera_light(
    levels: LightLevels, position: NDArray[np.float64], lights: tuple[Light, ...], *, has_key_light: bool
) -> CameraLight:
    """Return the light of images.

    The scene's lights are dimmed by one factor if they would give more than the light 1 at the camera together:
    lux and candela of glTF files have no exposure to go with them, and some have 100,000.

    Args:
        levels: light of each source.
        position: (3,), place of the lamp in the world.
        lights: lights of the scene.
        has_key_light: True: there is a key light, and no lamp.
    """
    at_camera = sum(_illuminance(light, position) for light in lights)
    factor = levels.scene / max(at_camera, 1.0)
    return CameraLight(
        position=tuple(position.tolist()),
        lamp=0.0 if has_key_light else levels.lamp,
        sky=max(levels.sky, MIN_AMBIENT),
        ground=max(levels.ground, MIN_AMBIENT),
        lights=tuple(replace(light, intensity=light.intensity * factor) for light in lights),
    )


def _illuminance(light: Light, position: NDArray[np.float64]) -> float:
    """Return the illuminance of a surface at a position that faces a light, in lux; a spot counts as a point."""
    brightest = light.intensity * max(light.color)
    if light.kind is LightKind.DIRECTIONAL:
        return brightest
    return brightest / max(float(np.linalg.norm(position - light.position)), _MIN_DISTANCE) ** 2


def scene_light(
    depth: NDArray[np.float32], normal: NDArray[np.float32], camera: Camera, light: CameraLight
) -> NDArray[np.float32]:
    """Return the light on each pixel's surface, (H, W) float32; 1 on the background and on unlit surfaces.

    Args:
        depth: (H, W) float32, metres, +inf: background.
        normal: (H, W, 3) float32, unit normals in the camera's frame; 0: unlit (points, lines).
        camera: camera of ``depth`` and ``normal``.
        light: parts of the light.
    """
    height, width = depth.shape
    job, total = CameraLightJob(light, camera), np.empty(height * width + vec.LANES, np.float32)
    _write_light(
        job.address,
        address_of(depth, np.float32),
        address_of(normal, np.float32),
        *(camera.fx, camera.fy, camera.cx, camera.cy),
        *(width, height),
        address_of(total, np.float32),
    )
    return total[: height * width].reshape(height, width)


@kernel
def _write_light(
    light_address: Address,
    depth_address: Address,
    normal_address: Address,
    fx: F64,
    fy: F64,
    cx: F64,
    cy: F64,
    width: I64,
    height: I64,
    total_address: Address,
) -> None:
    """Write ``scene_light``, and up to seven values more.

    Args:
        light_address: address of a CameraLightInputs.
        depth_address, normal_address, total_address: addresses of the first pixels.
    """
    light, depth, normals, total = (
        CameraLightInputs(light_address),
        f32_at(depth_address),
        f32_at(normal_address),
        f32_at(total_address),
    )
    zero, one, last = vec.f32(0.0), vec.f32(1.0), vec.i32(width * height - 1)
    for row in range(height):
        ray_y = vec.f32((row + 0.5 - cy) / fy)
        for column in range(0, width, vec.LANES):
            pixel = vec.minimum(vec.i32(row * width + column) + vec.iota(), last)
            ray_x = (vec.to_f32(vec.i32(column) + vec.iota()) + vec.f32(0.5 - cx)) * vec.f32(1.0 / fx)
            z, first = vec.gather(depth, pixel), pixel * vec.i32(3)
            normal = (
                vec.gather(normals, first),
                vec.gather(normals, first + vec.i32(1)),
                vec.gather(normals, first + vec.i32(2)),
            )
            is_lit = (z < vec.f32(np.inf)) & (
                normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2] > zero
            )
            z = vec.select(is_lit, z, one)
            light_here = total_light(light, normal, (ray_x * z, ray_y * z, z))
            vec.store(total, row * width + column, vec.select(is_lit, light_here, one))


def shadow_camera(depth: NDArray[np.float32], camera: Camera, divisor: int) -> Camera | None:
    """Return the camera of the shadow map, which looks along the key light; None if no point is visible.

    Args:
        depth: (H, W) float32, metres, +inf: background.
        camera: camera of ``depth``.
        divisor: width of the images that get the light divided by that of ``depth``.
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
    texel_metres = _TEXEL_PIXELS / divisor * metres_per_pixel(points, camera)
    return light_camera(STUDIO.lights[0], points, MAX_SHADOW_SIDE, texel_metres)
