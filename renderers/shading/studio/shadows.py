"""Shadow maps: the scene as a light sees it, drawn by the rasterizer like any other view.

A directional light becomes a camera so far away that its rays differ by half a degree at most, as the sun's do. Maps
are fitted to what the picture shows (Lauritzen, Salvi, Lefohn, "Sample Distribution Shadow Maps", 2011), not to the
scene, which may have a floor of a hundred metres. The fit goes in steps, so that a camera that moves a little finds the
map of the picture before; a map depends on scene, light and step alone, never on what was drawn before. Borders are
filtered by percentage closer filtering (Reeves, Salesin, Cook 1987) with bilinear weights; the receiver's own plane
gives its depth at every texel, so that a plane never shadows itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import Cache
from renderers.camera import Camera
from renderers.compiler.pointers import address_of
from renderers.drawlist import AlphaMode, DrawList, Instance, Light, LightKind, Topology

if TYPE_CHECKING:  # the rasterizer calls this room
    from renderers.visibility_buffer import Rasterizer, Visibility

S_MAP: Final = 0  # 12: rows of the camera's optical frame to the light's
S_FOCAL: Final = 12
S_CENTER: Final = 13
S_OFFSET: Final = 14  # metres along the normal by which receivers are lifted, per metre from the light
S_COLUMNS: Final = 15
SI_INV_Z: Final = 0
SI_SIDE: Final = 1
SI_COLUMNS: Final = 2

_FARNESS: Final = 100.0
"""Distance of the camera that stands for a directional light, in radii of what it must see."""
_LIFT: Final = 1.5
"""Texels by which receivers are lifted along their normal: a curved mesh is not the plane of the triangle."""
_SAMPLES: Final = 4096
"""Visible points that a map is fitted to, about."""
_SPREAD: Final = 1.5
"""A picture's far ground is left unshadowed beyond this many times the distance within which three quarters of its
pixels lie."""


MAX_MAP_BYTES: Final = 128 << 20
"""Maps kept for scenes that are alive: eight of 2048 x 2048 texels, a rig of four lights for two scenes."""
MAPS_PER_SCENE: Final = 8
"""Maps kept of one scene: four lights and a camera that goes to and fro over the border of a step."""
_COARSENESS: Final = 1.25
"""Texels of a map are at most so many times as large as a pixel of the picture at a middling distance: the filter takes
five of them, and finer borders are hardly seen."""
_LEAST_SIDE: Final = 512
"""A map of that size costs a millisecond."""
_STEPS: Final = (0.5946035575013605, 0.7071067811865476, 0.8408964152537145, 1.0)
"""Sizes of a map within an octave, 2^(k/4)."""
_ROOM: Final = 16.0 / 15.0
"""How much larger a map is than what it must hold: its middle goes in steps of an eighth of its radius."""


MAX_CUT_OUT: Final = 8
"""Cut-out surfaces behind one another that the light is followed through: each is another drawing of them all. Where it
passes holes in as many, it goes on."""
Cut = Callable[["Visibility", Camera], NDArray[np.bool_]]
"""Where (H, W) a layer that a camera sees is not cut out."""


@dataclass(frozen=True, slots=True, eq=False)
class ShadowMap:
    """One light's view."""

    camera: Camera
    inv_z: NDArray[np.float32]
    """(side, side) float32: 1 / distance along the light's axis of the nearest caster, below 0 where none is."""


_maps: Cache[DrawList, tuple[ShadowMap, ...]] = Cache(MAX_MAP_BYTES, weak=True)
"""The newest first."""


def map_side(largest: int, extent: float, pixel: float) -> int:
    """Texels of the side of a map: ``largest``, halved as long as they stay small.

    Args:
        extent: metres that it covers. pixel: metres that a pixel of the picture covers.
    """
    while largest >= 2 * _LEAST_SIDE and _COARSENESS * pixel * (largest // 2) >= extent:
        largest //= 2
    return largest


def casters(instances: Sequence[Instance]) -> NDArray[np.bool_]:
    """(n,): who casts shadows: surfaces that are not blended."""
    return np.array(
        [i.mesh.topology is Topology.TRIANGLES and i.material.alpha_mode is not AlphaMode.BLEND for i in instances],
        np.bool_,
    )


def visible_points(seen: Visibility, camera: Camera) -> NDArray[np.float64]:
    """(n, 3) float64: a grid of visible points in the world, without the far ones (``_SPREAD``)."""
    height, width = seen.ids.shape
    step = max(1, round(math.sqrt(height * width / _SAMPLES)))
    rows, columns = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    hit = seen.ids[rows, columns] >= 0
    z = 1.0 / seen.inv_z[rows, columns][hit].astype(np.float64)
    if not z.size:
        return np.zeros((0, 3))
    near = z <= _SPREAD * np.quantile(z, 0.75)
    x = (columns[hit] + 0.5 - camera.cx) / camera.fx * z
    y = (rows[hit] + 0.5 - camera.cy) / camera.fy * z
    points = np.stack((x, y, z), -1)[near]
    world: NDArray[np.float64] = points @ camera.X_world_camera[:3, :3].T + camera.X_world_camera[:3, 3]
    return world[np.isfinite(world).all(axis=-1)]


def pixel_size(points: NDArray[np.float64], camera: Camera) -> float:
    """Metres that a pixel of a picture covers at the median distance of points (n, 3) of the world."""
    if not len(points):
        return 0.0
    depth = (points - camera.X_world_camera[:3, 3]) @ camera.X_world_camera[:3, 2]
    return float(np.median(depth)) / max(camera.fx, camera.fy)


def light_camera(light: Light, points: NDArray[np.float64], largest: int, pixel: float) -> Camera | None:
    """The camera of a light's map, fitted to points (n, 3) of the world; None: it has nothing to see or no map.

    Args:
        largest, pixel: as in ``map_side``.
    """
    if light.kind is LightKind.POINT or not len(points):
        return None
    ahead = np.array(light.direction, np.float64)
    ahead /= np.linalg.norm(ahead)
    side = np.cross(ahead, (0.0, 0.0, 1.0) if abs(ahead[2]) < 0.9 else (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side)
    X = np.eye(4)
    X[:3, :3] = np.stack((side, np.cross(ahead, side), ahead), -1)
    if light.kind is LightKind.SPOT:
        X[:3, 3] = light.position
        depth = (points - X[:3, 3]) @ ahead
        if not (depth > 0.0).any():
            return None
        slope = math.tan(min(light.outer_cone, math.radians(80.0)))
        size = map_side(largest, 2.0 * slope * float(np.median(depth)), pixel)
        focal, centre = 0.5 * size / slope, 0.5 * size
        near = math.ldexp(1e-3, math.frexp(float(depth.max()))[1] - 1)
        return Camera(size, size, focal, focal, centre, centre, near, math.inf, X)
    local = points @ X[:3, :3]
    low, high = local.min(axis=0), local.max(axis=0)
    mantissa, exponent = math.frexp(_ROOM * max(0.5 * float((high - low)[:2].max()), 1e-6) * 1.02)
    radius = math.ldexp(next(step for step in _STEPS if mantissa <= step), exponent)
    cell = 0.125 * radius
    middle = np.round(0.5 * (low + high)[:2] / cell) * cell
    first, last = math.floor(low[2] / radius) * radius, math.ceil(high[2] / radius) * radius
    distance = _FARNESS * max(radius, 0.5 * (last - first))
    radius *= 1.0 + (last - first) / distance  # what is nearer to the light looks larger
    X[:3, 3] = X[:3, :3] @ np.array((*middle, first - distance))
    size = map_side(largest, 2.0 * radius, pixel)
    focal, centre = 0.5 * size * distance / radius, 0.5 * size
    return Camera(size, size, focal, focal, centre, centre, 1e-2 * distance, math.inf, X)


def _same(a: Camera, b: Camera) -> bool:
    return (a.width, a.fx, a.near) == (b.width, b.fx, b.near) and np.array_equal(a.X_world_camera, b.X_world_camera)


def _map_of(rasterizer: Rasterizer, scene: DrawList, camera: Camera, cut_out: NDArray[np.bool_], cut: Cut) -> ShadowMap:
    """The map that a camera sees, drawn once while the scene lives and the map was used lately."""
    for each in _maps.get(scene) or ():
        if _same(each.camera, camera):
            return each
    casting = casters(scene.instances)
    whole, cut_out = casting & ~cut_out, casting & cut_out
    with rasterizer.visibility(scene, camera, select=whole) as seen:
        inv_z = seen.inv_z.copy()
        if cut_out.any():
            _add_cut_out(rasterizer, scene, camera, cut_out, cut, seen, inv_z)
    fresh = ShadowMap(camera, inv_z)
    kept = (fresh, *(_maps.get(scene) or ()))[:MAPS_PER_SCENE]
    _maps.put(scene, kept, sum(each.inv_z.nbytes for each in kept))
    return fresh


def _add_cut_out(
    rasterizer: Rasterizer,
    scene: DrawList,
    camera: Camera,
    select: NDArray[np.bool_],
    cut: Cut,
    behind: Visibility,
    inv_z: NDArray[np.float32],
) -> None:
    """Put what is nearer than ``behind`` and not cut out into a map."""
    beyond: Visibility | None = None
    try:
        for _ in range(MAX_CUT_OUT):
            layer = rasterizer.visibility(scene, camera, select=select, beyond=beyond, before=behind)
            if beyond is not None:
                beyond.close()
            beyond = layer
            if not (layer.ids >= 0).any():
                break
            there = cut(layer, camera)
            np.copyto(inv_z, layer.inv_z, where=there)
            layer.ids[there] = -1  # nothing behind matters
    finally:
        if beyond is not None:
            beyond.close()


def draw_maps(
    rasterizer: Rasterizer,
    scene: DrawList,
    lights: Sequence[Light],
    points: NDArray[np.float64],
    largest: int,
    pixel: float,
    limit: int,
    cut_out: NDArray[np.bool_],
    cut: Cut,
) -> tuple[list[ShadowMap], list[int]]:
    """The maps of the first ``limit`` lights that can have one, and each light's map or -1.

    Args:
        points: (n, 3), visible ones. largest, pixel: as in ``map_side``.
        cut_out: (n,): of which instances only a part may be there, as ``cut`` says.
    """
    maps: list[ShadowMap] = []
    rows: list[int] = []
    for light in lights:
        camera = light_camera(light, points, largest, pixel) if light.casts_shadow and len(maps) < limit else None
        rows.append(-1 if camera is None else len(maps))
        if camera is not None:
            maps.append(_map_of(rasterizer, scene, camera, cut_out, cut))
    return maps, rows


def shadow_tables(maps: Sequence[ShadowMap], camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(n, S_COLUMNS) float64 and (n, SI_COLUMNS) int64, at least one row."""
    floats = np.zeros((max(len(maps), 1), S_COLUMNS))
    integers = np.zeros((max(len(maps), 1), SI_COLUMNS), np.int64)
    for row, columns, each in zip(floats, integers, maps, strict=False):
        row[S_MAP : S_MAP + 12] = (each.camera.X_camera_world @ camera.X_world_camera)[:3].reshape(-1)
        row[S_FOCAL], row[S_CENTER] = each.camera.fx, each.camera.cx
        row[S_OFFSET] = _LIFT / each.camera.fx
        columns[:] = address_of(each.inv_z, np.float32), each.camera.width
    return floats, integers
