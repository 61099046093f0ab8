"""Light of camera images (``shading.camera_light``): lamp, sky, ground, further lights, and the key light's shadow map.

A rendered image is the product of it and of what surfaces reflect. Light that is added to the image afterwards, a
projector's or the key light's, is divided by it.

The key light and the fit of its shadow map are those of the ``studio`` look (``renderers.shading.studio.shadows``).
"""

import itertools
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import Light, LightKind
from renderers.light_rig import STUDIO, CameraLight, KeyLight
from renderers.shading.camera_light import MIN_AMBIENT
from renderers.shading.studio.shadows import light_camera, metres_per_pixel, near_points
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
_MIN_COSINE: Final = 0.2
"""Minimum cosine between normal and key light of the points of ``with_share_of_light``."""
_REACH: Final = 2
"""Texels beside a point at which the light must reach its surface, too."""
_MIN_SHARE: Final = 0.005
"""Share of the visible points from which the key light has its level: less is no sunlit place, but a seam."""


def camera_light(
    levels: LightLevels, position: NDArray[np.float64], lights: tuple[Light, ...], *, has_key_light: bool
) -> CameraLight:
    """Return the light of images, at the levels of its sources.

    The scene's lights are dimmed by one factor if they would give more than the light 1 at the camera together: lux and
    candela of glTF files have no exposure to go with them, and some have 100,000.

    Args:
        position: place of the lamp in the world.
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


def shadow_camera(depth: NDArray[np.float32], camera: Camera, divisor: int) -> Camera | None:
    """Return the camera of the shadow map, which looks along the key light; None if no point is visible.

    Args:
        camera: camera of ``depth``.
        divisor: width of the images that get the light divided by that of ``depth``.
    """
    start = _FIT_STEP // 2
    z = depth[start::_FIT_STEP, start::_FIT_STEP].astype(np.float64)
    rows, columns = np.nonzero(np.isfinite(z))
    if not rows.size:
        return None
    points = near_points(z[rows, columns], columns * _FIT_STEP + start, rows * _FIT_STEP + start, camera)
    texel_metres = _TEXEL_PIXELS / divisor * metres_per_pixel(points, camera)
    return light_camera(STUDIO.lights[0], points, MAX_SHADOW_SIDE, texel_metres)


def with_share_of_light(
    key: KeyLight, depth: NDArray[np.float32], normal: NDArray[np.float32], camera: Camera
) -> KeyLight | None:
    """Return a key light as strong, and as strong beyond its map, as the share of the visible points that it reaches.

    In a closed room it reaches none: the result is None. Otherwise it would shine on seams of walls, which the shadow
    map cannot tell from the ceiling above them, and on the end of a corridor beyond the map.

    Args:
        depth: (H, W), metres, and
        normal: (H, W, 3), in the camera's frame, of the view of ``camera``.
    """
    light, start, step = key.camera, _FIT_STEP // 2, _FIT_STEP
    to_light = light.X_camera_world @ camera.X_world_camera
    z, normals = depth[start::step, start::step], normal[start::step, start::step] @ to_light[:3, :3].T
    rows, columns = np.nonzero((normals[:, :, 2] < -_MIN_COSINE) & np.isfinite(z))
    x, y = columns * step + start + 0.5 - camera.cx, rows * step + start + 0.5 - camera.cy
    rays = np.stack((x / camera.fx, y / camera.fy, np.ones(len(x))), -1)
    points = rays * z[rows, columns, None].astype(np.float64) @ to_light[:3, :3].T + to_light[:3, 3]
    texel = points[:, 2] / light.fx
    u, v = (np.floor(points[:, axis] / texel + light.cx).astype(np.int64) for axis in (0, 1))
    inside = (np.minimum(u, v) >= _REACH) & (np.maximum(u, v) < light.width - _REACH)
    if not inside.any():
        return key
    u, v, light_z, texel = u[inside], v[inside], points[inside, 2], texel[inside]
    nx, ny, nz = normals[rows, columns][inside].T
    is_lit = np.ones(len(u), np.bool_)
    for du, dv in itertools.product((-_REACH, 0, _REACH), repeat=2):
        surface = light_z - texel * (du * nx + dv * ny - 1.0) / nz  # minus a texel where it faces the light
        is_lit &= key.depth[v + dv, u + du] >= surface
    share = float(is_lit.mean())
    if share == 0.0:
        return None
    return replace(key, level=key.level * min(share / _MIN_SHARE, 1.0), beyond=min(2.0 * share, 1.0))
