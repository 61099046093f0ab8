"""Shadow maps: views of the scene from lights, rendered by the rasterizer. ``shadow_sampling`` reads them.

The camera of a directional light is so far away that its rays differ by half a degree at most, as sunlight does. Maps
are fitted to the visible points (Lauritzen, Salvi, Lefohn, "Sample Distribution Shadow Maps", 2011), since the whole
scene may have a floor of a hundred metres. Size and centre of a map change in steps, so that the map is reused when the
camera moves a little. A map depends on scene, light and step only, never on earlier images. Borders of shadows are
filtered by percentage closer filtering (Reeves, Salesin, Cook 1987) with bilinear weights. The depth of the receiver's
plane is computed for every texel, so that a plane never shadows itself.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import WeakCache
from renderers.camera import Camera
from renderers.compiler.pointers import address_of
from renderers.drawlist import AlphaMode, DrawList, Instance, Light, LightKind, Topology
from renderers.shading.depth_peeling import SolidPixels, draw_cut_outs
from renderers.shading.studio.layout import StudioShadowMap
from renderers.visibility_buffer import Rasterizer, Visibility

MAPS_PER_SCENE: Final = 8
"""Maximum number of cached maps per scene: two steps of the fit for each of four lights."""
MAX_CUT_OUT_LAYERS: Final = 8
"""Maximum number of cut-out surfaces behind one another that cast shadows. Each layer takes one pass over them."""
_DIRECTIONAL_DISTANCE: Final = 100.0
"""Distance of the camera of a directional light, in radii of the region that the map covers."""
_NORMAL_OFFSET: Final = 1.5
"""Offset of receivers along their normal, texels. The triangles of a curved mesh lie beside the ideal surface."""
_FIT_POINTS: Final = 4096
"""Approximate number of visible points that a map is fitted to."""
_MAX_DEPTH_RATIO: Final = 1.5
"""Points deeper than this factor times the third quartile of the visible depths receive no shadows: a few of them would
make a map's texels large."""
_MAX_TEXEL_PIXELS: Final = 1.25
"""Maximum size of a texel in pixels of the image at the median distance. The filter takes five texels, so that finer
texels are hardly visible."""
_MIN_SIDE: Final = 512
"""Minimum side of a map, texels. Such a map is rendered in a millisecond."""
_SIZE_STEPS: Final = (0.5946035575013605, 0.7071067811865476, 0.8408964152537145, 1.0)
"""Radii of maps within an octave, 2^(k/4)."""
_CENTER_STEP: Final = 0.125
"""Step of a map's centre, as a share of the map's radius."""
_STEP_MARGIN: Final = 16.0 / 15.0
"""Factor of a map's radius, so that the map covers all points although its centre is rounded to a step."""


@dataclass(frozen=True, slots=True, eq=False)
class ShadowMap:
    """Depths seen from a light, and the light's camera."""

    camera: Camera
    inv_z: NDArray[np.float32]
    """(side, side) float32, 1/m: 1 / (distance of the nearest caster along the light's axis); 0: no caster."""


_maps: WeakCache[DrawList, tuple[ShadowMap, ...]] = WeakCache("shadow_maps")
"""Maps by scene, the newest first."""


def map_side(max_side: int, extent: float, pixel_metres: float) -> int:
    """Return the side of a map of ``extent`` metres in texels: ``max_side``, halved as long as texels stay small.

    ``pixel_metres`` is the size of a pixel of the image.
    """
    side = max_side
    while side >= 2 * _MIN_SIDE and _MAX_TEXEL_PIXELS * pixel_metres * (side // 2) >= extent:
        side //= 2
    return side


def casters(instances: Sequence[Instance]) -> NDArray[np.bool_]:
    """Return a mask of the instances that cast shadows, (n,): triangles whose material casts them, not blended."""
    triangles, blended = int(Topology.TRIANGLES), AlphaMode.BLEND
    return np.array(
        [
            i.mesh.elements.shape[1] == triangles and i.material.casts_shadow and i.material.alpha_mode is not blended
            for i in instances
        ],
        np.bool_,
    )


def visible_points(layer: Visibility, camera: Camera) -> NDArray[np.float64]:
    """Return the points of the world that a grid of pixels shows, (n, 3) float64, without distant ones."""
    height, width = layer.ids.shape
    step = max(1, round(math.sqrt(height * width / _FIT_POINTS)))
    rows, columns = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    is_surface = layer.ids[rows, columns] >= 0
    z = 1.0 / layer.inv_z[rows, columns][is_surface].astype(np.float64)
    if not z.size:
        return np.zeros((0, 3))
    return near_points(z, columns[is_surface], rows[is_surface], camera)


def near_points(
    z: NDArray[np.float64], columns: NDArray[np.intp], rows: NDArray[np.intp], camera: Camera
) -> NDArray[np.float64]:
    """Return the points of the world that pixels show at depths z, (n, 3), without distant ones."""
    x, y = (columns + 0.5 - camera.cx) / camera.fx * z, (rows + 0.5 - camera.cy) / camera.fy * z
    points = np.stack((x, y, z), -1)[z <= _MAX_DEPTH_RATIO * np.quantile(z, 0.75)]
    world: NDArray[np.float64] = points @ camera.X_world_camera[:3, :3].T + camera.X_world_camera[:3, 3]
    return world[np.isfinite(world).all(axis=-1)]


def metres_per_pixel(points: NDArray[np.float64], camera: Camera) -> float:
    """Return the size of a pixel at the median depth of points (n, 3) of the world; 0 without points."""
    if not len(points):
        return 0.0
    depth = (points - camera.X_world_camera[:3, 3]) @ camera.X_world_camera[:3, 2]
    return float(np.median(depth)) / max(camera.fx, camera.fy)


def light_camera(light: Light, points: NDArray[np.float64], max_side: int, pixel_metres: float) -> Camera | None:
    """Return the camera of a light's map, fitted to points (n, 3) of the world; further arguments: as ``map_side``.

    It is None for point lights, and for lights that reach none of the points.
    """
    if light.kind is LightKind.POINT or not len(points):
        return None
    forward = np.array(light.direction, np.float64)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0) if abs(forward[2]) < 0.9 else (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    R_world_light = np.stack((right, np.cross(forward, right), forward), -1)
    if light.kind is LightKind.SPOT:
        return _spot_camera(light, R_world_light, points, max_side, pixel_metres)
    return _directional_camera(R_world_light, points, max_side, pixel_metres)


def _spot_camera(
    light: Light, R_world_light: NDArray[np.float64], points: NDArray[np.float64], max_side: int, pixel_metres: float
) -> Camera | None:
    """Return the camera at a spot light; its map covers the light's cone."""
    depth = (points - np.array(light.position)) @ R_world_light[:, 2]
    if not (depth > 0.0).any():
        return None
    slope = math.tan(min(light.outer_cone, math.radians(80.0)))
    side = map_side(max_side, 2.0 * slope * float(np.median(depth)), pixel_metres)
    near = math.ldexp(1e-3, math.frexp(float(depth.max()))[1] - 1)
    return _map_camera(side, 0.5 * side / slope, near, R_world_light, np.array(light.position))


def _directional_camera(
    R_world_light: NDArray[np.float64], points: NDArray[np.float64], max_side: int, pixel_metres: float
) -> Camera:
    """Return the distant camera of a directional light. Its map covers the points; radius and centre are in steps."""
    points_light = points @ R_world_light
    low, high = points_light.min(axis=0), points_light.max(axis=0)
    mantissa, exponent = math.frexp(_STEP_MARGIN * max(0.5 * float((high - low)[:2].max()), 1e-6) * 1.02)
    radius = math.ldexp(next(step for step in _SIZE_STEPS if mantissa <= step), exponent)
    step = _CENTER_STEP * radius
    center = np.round(0.5 * (low + high)[:2] / step) * step
    nearest, farthest = math.floor(low[2] / radius) * radius, math.ceil(high[2] / radius) * radius
    distance = _DIRECTIONAL_DISTANCE * max(radius, 0.5 * (farthest - nearest))
    radius *= 1.0 + (farthest - nearest) / distance  # objects nearer to the camera look larger
    side = map_side(max_side, 2.0 * radius, pixel_metres)
    position = R_world_light @ np.array((*center, nearest - distance))
    return _map_camera(side, 0.5 * side * distance / radius, 1e-2 * distance, R_world_light, position)


def _map_camera(
    side: int, focal_length: float, near: float, R_world_light: NDArray[np.float64], position: NDArray[np.float64]
) -> Camera:
    X_world_light = np.eye(4)
    X_world_light[:3, :3], X_world_light[:3, 3] = R_world_light, position
    center = 0.5 * side
    return Camera(side, side, focal_length, focal_length, center, center, near, math.inf, X_world_light)


def shadow_map_of(
    rasterizer: Rasterizer, scene: DrawList, camera: Camera, transparent: NDArray[np.bool_], solid_pixels: SolidPixels
) -> ShadowMap:
    """Return the map for a light's camera, cached if possible; ``transparent``: instances that may be cut out."""
    for known in _maps.get(scene) or ():
        is_same = (known.camera.width, known.camera.fx, known.camera.near) == (camera.width, camera.fx, camera.near)
        if is_same and np.array_equal(known.camera.X_world_camera, camera.X_world_camera):
            return known
    is_caster = casters(scene.instances)
    solid, cut_out = is_caster & ~transparent, is_caster & transparent
    layer = rasterizer.visibility(scene, camera, select=solid)
    if cut_out.any():
        draw_cut_outs(rasterizer, scene, camera, cut_out, layer, solid_pixels, MAX_CUT_OUT_LAYERS)
    new = ShadowMap(camera, layer.inv_z)
    newest = (new, *(_maps.get(scene) or ()))[:MAPS_PER_SCENE]
    _maps.put(scene, newest, sum(each.inv_z.nbytes for each in newest))
    return new


def render_shadow_maps(
    rasterizer: Rasterizer,
    scene: DrawList,
    lights: Sequence[Light],
    points: NDArray[np.float64],
    max_side: int,
    pixel_metres: float,
    max_maps: int,
    transparent: NDArray[np.bool_],
    solid_pixels: SolidPixels,
) -> tuple[list[ShadowMap], list[int]]:
    """Return the maps of the first ``max_maps`` lights that can have one, and each light's index of its map or -1.

    They are fitted to ``points`` from ``visible_points``. Other arguments are those of ``map_side`` and
    ``shadow_map_of``.
    """
    maps: list[ShadowMap] = []
    map_of_light: list[int] = []
    for light in lights:
        has_map = light.casts_shadow and len(maps) < max_maps
        camera = light_camera(light, points, max_side, pixel_metres) if has_map else None
        map_of_light.append(-1 if camera is None else len(maps))
        if camera is not None:
            maps.append(shadow_map_of(rasterizer, scene, camera, transparent, solid_pixels))
    return maps, map_of_light


def shadow_map_structs(maps: Sequence[ShadowMap], camera: Camera) -> NDArray[Any]:
    """Return an array of StudioShadowMap, one per map and at least one. Valid while ``maps`` is alive."""
    structs = np.zeros(max(len(maps), 1), StudioShadowMap.dtype)
    for struct, shadow_map in zip(structs, maps, strict=False):
        light = shadow_map.camera
        struct["X_light_camera"] = (light.X_camera_world @ camera.X_world_camera)[:3].reshape(-1)
        struct["focal_length"], struct["center"] = light.fx, light.cx
        struct["normal_offset"] = _NORMAL_OFFSET / light.fx
        struct["inv_z"], struct["side"] = address_of(shadow_map.inv_z, np.float32), light.width
    return structs
