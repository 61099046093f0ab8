"""Light that the lamp, the sky, the ground and further lights give to each pixel's surface (``shading.camera_light``).

A rendered image is the product of it and of what surfaces reflect. Light that is added to the image afterwards, a
projector's or the key light's, is divided by it.

The key light and the fit of its shadow map are those of the ``studio`` look (``renderers.shading.studio.shadows``). Its
factors have half the image's resolution, because they are smooth except at the edges of objects.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F32, F64, I64, Address, Array1, Array2, Pointer, i64
from renderers.compiler.pointers import address_of, f32_at
from renderers.compiler.simd import F32x8
from renderers.drawlist import Light, LightKind
from renderers.light_rig import STUDIO, CameraLight
from renderers.shading.camera_light import MIN_AMBIENT, CameraLightInputs, CameraLightJob, total_light
from renderers.shading.studio.shadows import light_camera, metres_per_pixel
from renderers.stereo.light.levels import LightLevels

_MIN_DISTANCE: Final = 1.0
"""Distance below which lights are not dimmed any further, metres."""
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
    height, width = depth.shape
    factors = np.empty(height * width + vec.LANES, np.float32)
    X_light_camera = np.ascontiguousarray((light.X_camera_world @ camera.X_world_camera)[:3])
    offset = _NORMAL_OFFSET / light.fx  # per metre of distance from the light
    _write_factors(
        address_of(depth, np.float32), address_of(normal, np.float32), (width, height),
        np.array((camera.fx, camera.fy, camera.cx, camera.cy)),
        address_of(shadow_depth, np.float32), X_light_camera,
        np.array((light.fx, light.cx, offset, float(len(shadow_depth)))),
        address_of(scene_light, np.float32), float(key_light), address_of(factors, np.float32),
    )  # fmt: skip
    return factors[: height * width].reshape(height, width).astype(np.uint8)


@inlined
def _lit_share(shadow_depth: Pointer[F32], side: I64, u: F32x8, v: F32x8, z: F32x8) -> F32x8:
    """Return the share of a light that reaches points, from four texels with bilinear weights; 1 outside of the map.

    Args:
        shadow_depth: (side, side), metres, +inf: nothing.
        u, v: positions in the map, texels.
        z: depths of the points, metres.
    """
    zero, one, last = vec.f32(0.0), vec.f32(1.0), vec.f32(side - 1)
    u, v = u - vec.f32(0.5), v - vec.f32(0.5)
    is_inside = (zero < u) & (u < last) & (zero < v) & (v < last)
    u, v = vec.select(is_inside, u, zero), vec.select(is_inside, v, zero)
    i, j = vec.to_i32(u), vec.to_i32(v)
    fu, fv = u - vec.to_f32(i), v - vec.to_f32(j)
    texel = j * vec.i32(side) + i
    share = zero
    for offset, weight in (
        (0, (one - fu) * (one - fv)),
        (1, fu * (one - fv)),
        (side, (one - fu) * fv),
        (side + 1, fu * fv),
    ):
        is_lit = vec.gather(shadow_depth, texel + vec.i32(offset)) >= z
        share = share + vec.select(is_lit, weight, zero)
    return vec.select(is_inside, share, one)


@kernel
def _write_factors(
    depth_address: Address,
    normal_address: Address,
    size: tuple[I64, I64],
    intrinsics: Array1[np.float64],
    shadow_address: Address,
    X_light_camera: Array2[np.float64],
    shadow_map: Array1[np.float64],
    scene_light_address: Address,
    key_light: F64,
    factors_address: Address,
) -> None:
    """Write ``light_factors`` as float32, and up to seven values more.

    Args:
        depth_address, normal_address, shadow_address, scene_light_address, factors_address: addresses of the first
            pixels.
        size: width and height of the image.
        intrinsics: (4,): fx, fy, cx, cy of the camera, pixels.
        X_light_camera: (3, 4), from the camera's frame to the light's.
        shadow_map: (4,): focal length and principal point, texels; offset of a point along its normal, metres
            per metre of distance from the light; side of the map, texels.
    """
    depth, normals, scene_light = f32_at(depth_address), f32_at(normal_address), f32_at(scene_light_address)
    shadow_depth, side, factors = f32_at(shadow_address), i64(shadow_map[3]), f32_at(factors_address)
    width, height = size
    inv_fx, inv_fy, cx, cy = 1.0 / intrinsics[0], 1.0 / intrinsics[1], intrinsics[2], intrinsics[3]
    zero, one, last = vec.f32(0.0), vec.f32(1.0), vec.i32(width * height - 1)
    focal_length, center, normal_offset = vec.f32(shadow_map[0]), vec.f32(shadow_map[1]), vec.f32(shadow_map[2])
    x_row, y_row, z_row = X_light_camera[0], X_light_camera[1], X_light_camera[2]
    for row in range(height):
        ray_y = vec.f32((row + 0.5 - cy) * inv_fy)
        for column in range(0, width, vec.LANES):
            pixel = vec.minimum(vec.i32(row * width + column) + vec.iota(), last)
            ray_x = (vec.to_f32(vec.i32(column) + vec.iota()) + vec.f32(0.5 - cx)) * vec.f32(inv_fx)
            z, first = vec.gather(depth, pixel), pixel * vec.i32(3)
            nx, ny = vec.gather(normals, first), vec.gather(normals, first + vec.i32(1))
            nz = vec.gather(normals, first + vec.i32(2))
            is_lit = (z < vec.f32(np.inf)) & (nx * nx + ny * ny + nz * nz > zero)
            z = vec.select(is_lit, z, one)
            x, y = ray_x * z, ray_y * z
            # The light looks along its z axis, in one direction for all points: it is far away.
            n_l = zero - (vec.f32(z_row[0]) * nx + vec.f32(z_row[1]) * ny + vec.f32(z_row[2]) * nz)
            offset = normal_offset * _coordinate(z_row, x, y, z)
            x, y, z = x + offset * nx, y + offset * ny, z + offset * nz
            light_z = _coordinate(z_row, x, y, z)
            scale = focal_length / light_z
            # A texel has one depth, but the depths of a slanted surface differ within it.
            bias = vec.f32(0.5) * offset / vec.maximum(n_l, vec.f32(0.2))
            u, v = _coordinate(x_row, x, y, z) * scale + center, _coordinate(y_row, x, y, z) * scale + center
            share = _lit_share(shadow_depth, side, u, v, light_z - bias)
            added = vec.f32(key_light) * share * vec.maximum(n_l, zero) / vec.gather(scene_light, pixel)
            factor = vec.minimum((one + added) * vec.f32(FACTOR_ONE) + vec.f32(0.5), vec.f32(255.0))
            vec.store(factors, row * width + column, vec.select(is_lit, factor, vec.f32(FACTOR_ONE)))


@inlined
def _coordinate(matrix_row: Array1[np.float64], x: F32x8, y: F32x8, z: F32x8) -> F32x8:
    """Return one coordinate of points, transformed by a row of a (3, 4) matrix."""
    return vec.f32(matrix_row[0]) * x + vec.f32(matrix_row[1]) * y + vec.f32(matrix_row[2]) * z + vec.f32(matrix_row[3])
