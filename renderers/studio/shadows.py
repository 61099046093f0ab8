"""Shadow maps: the scene as a light sees it, drawn by the rasterizer like any other view.

A directional light becomes a camera so far away that its rays differ by half a degree at most, as the sun's do. Maps
are fitted to what the picture shows (Lauritzen, Salvi, Lefohn, "Sample Distribution Shadow Maps", 2011), not to the
scene, which may have a floor of a hundred metres. Borders are filtered by percentage closer filtering (Reeves,
Salesin, Cook 1987) with bilinear weights; the receiver's own plane gives its depth at every texel, so that a plane
never shadows itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Instance, Light, LightKind, Topology
from renderers.pointers import address_of

if TYPE_CHECKING:  # the rasterizer calls this room
    from renderers.cpu.visibility import Rasterizer, Visibility

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


@dataclass(frozen=True, slots=True, eq=False)
class ShadowMap:
    """One light's view."""

    camera: Camera
    seen: Visibility


def casters(instances: Sequence[Instance]) -> NDArray[np.bool_]:
    """(n,): who casts shadows: surfaces that are not blended. Cut-out ones cast the shadow of their whole shape."""
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
    return world


def light_camera(light: Light, points: NDArray[np.float64], size: int) -> Camera | None:
    """The camera of a light's map, fitted to points (n, 3) of the world; None: it has nothing to see or no map."""
    if light.kind is LightKind.POINT or not len(points):
        return None
    ahead = np.array(light.direction, np.float64)
    ahead /= np.linalg.norm(ahead)
    side = np.cross(ahead, (0.0, 0.0, 1.0) if abs(ahead[2]) < 0.9 else (0.0, 1.0, 0.0))
    side /= np.linalg.norm(side)
    X = np.eye(4)
    X[:3, :3] = np.stack((side, np.cross(ahead, side), ahead), -1)
    centre = 0.5 * size
    if light.kind is LightKind.SPOT:
        X[:3, 3] = light.position
        depth = (points - X[:3, 3]) @ ahead
        if not (depth > 0.0).any():
            return None
        focal = centre / math.tan(min(light.outer_cone, math.radians(80.0)))
        return Camera(size, size, focal, focal, centre, centre, 1e-3 * float(depth.max()), math.inf, X)
    local = points @ X[:3, :3]
    low, high = local.min(axis=0), local.max(axis=0)
    radius = max(0.5 * float((high - low)[:2].max()), 1e-6) * 1.02
    distance = _FARNESS * max(radius, 0.5 * float(high[2] - low[2]))
    radius *= 1.0 + float(high[2] - low[2]) / distance  # what is nearer to the light looks larger
    X[:3, 3] = X[:3, :3] @ np.array((*(0.5 * (low + high))[:2], low[2] - distance))
    focal = centre * distance / radius
    return Camera(size, size, focal, focal, centre, centre, 1e-2 * distance, math.inf, X)


def draw_maps(
    rasterizer: Rasterizer, scene: DrawList, lights: Sequence[Light], points: NDArray[np.float64], size: int, limit: int
) -> tuple[list[ShadowMap], list[int]]:
    """The maps of the first ``limit`` lights that can have one, and each light's map or -1.

    Whoever calls closes the maps.
    """
    maps: list[ShadowMap] = []
    rows: list[int] = []
    select = casters(scene.instances)
    for light in lights:
        camera = light_camera(light, points, size) if light.casts_shadow and size and len(maps) < limit else None
        rows.append(-1 if camera is None else len(maps))
        if camera is not None:
            maps.append(ShadowMap(camera, rasterizer.visibility(scene, camera, select=select)))
    return maps, rows


def shadow_tables(maps: Sequence[ShadowMap], camera: Camera) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """(n, S_COLUMNS) float64 and (n, SI_COLUMNS) int64, at least one row."""
    floats = np.zeros((max(len(maps), 1), S_COLUMNS))
    integers = np.zeros((max(len(maps), 1), SI_COLUMNS), np.int64)
    for row, columns, each in zip(floats, integers, maps, strict=False):
        row[S_MAP : S_MAP + 12] = (each.camera.X_camera_world @ camera.X_world_camera)[:3].reshape(-1)
        row[S_FOCAL], row[S_CENTER] = each.camera.fx, each.camera.cx
        row[S_OFFSET] = _LIFT / each.camera.fx
        columns[:] = address_of(each.seen.inv_z, np.float32), each.camera.width
    return floats, integers
