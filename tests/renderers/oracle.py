"""A slow rasterizer in plain numpy, float64 and exact integers, the reference for ``renderers.raster``.

It shares no code with the kernels: edge functions are evaluated at every pixel centre of the picture, depth is solved
from each element's own plane, nothing is binned, and of the clipping planes only the near one is used.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList

Polygon = list[NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class Picture:
    """Images that the oracle renders."""

    ids: NDArray[np.int64]
    """(H, W): record numbers, -1 for the background."""
    depth: NDArray[np.float64]
    """(H, W): +inf for the background."""
    hits: NDArray[np.int64]
    """(H, W): how many elements cover the pixel between the clipping planes."""


def snap(point: NDArray[np.float64], camera: Camera) -> tuple[int, int]:
    """Return the grid coordinates (1/256 px) of a point in the optical frame."""
    x = np.float32(camera.fx * point[0] / point[2] + camera.cx)
    y = np.float32(camera.fy * point[1] / point[2] + camera.cy)
    return int(np.rint(np.float64(x) * 256.0)), int(np.rint(np.float64(y) * 256.0))


def clip_near(polygon: Polygon, near: float) -> Polygon:
    """Clip a polygon to z >= near (Sutherland-Hodgman)."""
    out: Polygon = []
    for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        if a[2] >= near:
            out.append(a)
        if (a[2] >= near) != (b[2] >= near):
            t = (a[2] - near) / (a[2] - b[2])
            cut = a + t * (b - a)
            cut[2] = near
            out.append(cut)
    return out


def convex_cover(corners: list[tuple[int, int]], width: int, height: int) -> NDArray[np.bool_]:
    """Pixels whose centre is in a triangle of grid points by the top-left rule; Python integers, so always exact."""
    (x0, y0), (x1, y1), (x2, y2) = corners
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0:
        return np.zeros((height, width), dtype=bool)
    if area < 0:
        corners = [corners[0], corners[2], corners[1]]
    big = max(abs(v) for corner in corners for v in corner) > 2**28
    kind = object if big else np.int64
    px = (np.arange(width, dtype=kind) * 256 + 128)[None, :]
    py = (np.arange(height, dtype=kind) * 256 + 128)[:, None]
    inside = np.ones((height, width), dtype=bool)
    for (xa, ya), (xb, yb) in zip(corners, corners[1:] + corners[:1], strict=True):
        edge = (xb - xa) * (py - ya) - (yb - ya) * (px - xa)
        closed = yb < ya or (yb == ya and xb > xa)
        inside &= (edge >= 0 if closed else edge > 0).astype(bool)
    return inside


def draw(scene: DrawList, camera: Camera) -> Picture:
    """Render all instances, both sides of their triangles."""
    width, height = camera.width, camera.height
    ids = np.full((height, width), -1, dtype=np.int64)
    best = np.zeros((height, width))
    hits = np.zeros((height, width), dtype=np.int64)
    rays = np.empty((height, width, 3))
    rays[..., 0] = (np.arange(width) + 0.5 - camera.cx) / camera.fx
    rays[..., 1] = ((np.arange(height) + 0.5 - camera.cy) / camera.fy)[:, None]
    rays[..., 2] = 1.0
    record = -1
    for instance in scene.instances:
        X = camera.X_camera_world @ instance.X_world_mesh
        points = instance.mesh.positions.astype(np.float64) @ X[:3, :3].T + X[:3, 3]
        for element in instance.mesh.elements:
            record += 1
            p = [points[index].copy() for index in element]
            if not np.isfinite(p).all():
                continue
            if len(element) == 3:
                covered, inverse = _triangle(p, rays, camera)
            elif len(element) == 2:
                covered, inverse = _line(p, instance.material.line_width, camera)
            else:
                covered, inverse = _point(p[0], instance.material.point_size, camera)
            covered &= inverse >= 1.0 / camera.far
            hits += covered
            nearer = covered & (inverse >= best)  # of equally near ones the last is seen
            best[nearer] = inverse[nearer]
            ids[nearer] = record
    with np.errstate(divide="ignore"):
        return Picture(ids, np.where(ids >= 0, 1.0 / best, np.inf), hits)


def _triangle(p: Polygon, rays: NDArray[np.float64], camera: Camera) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    covered = np.zeros(rays.shape[:2], dtype=bool)
    polygon = clip_near(p, camera.near)
    if len(polygon) < 3:
        return covered, np.zeros(rays.shape[:2])
    corners = [snap(q, camera) for q in polygon]
    for k in range(2, len(corners)):
        covered |= convex_cover([corners[0], corners[k - 1], corners[k]], camera.width, camera.height)
    normal = np.cross(p[1] - p[0], p[2] - p[0])
    distance = normal @ p[0]
    with np.errstate(all="ignore"):
        inverse = rays @ normal / distance
    z = [q[2] for q in polygon]
    inverse = np.clip(np.nan_to_num(inverse, nan=0.0), 1.0 / max(z), 1.0 / min(z))
    return covered, inverse


def _line(p: Polygon, line_width: float, camera: Camera) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    shape = (camera.height, camera.width)
    if p[0][2] < camera.near and p[1][2] < camera.near:
        return np.zeros(shape, dtype=bool), np.zeros(shape)
    for a, b in ((0, 1), (1, 0)):
        if p[a][2] < camera.near:
            t = (p[b][2] - camera.near) / (p[b][2] - p[a][2])
            p[a] = p[b] + t * (p[a] - p[b])
            p[a][2] = camera.near
    (x0, y0), (x1, y1) = snap(p[0], camera), snap(p[1], camera)
    half = round(max(line_width, 1.0) * 128)
    ox, oy = (0, half) if abs(x1 - x0) >= abs(y1 - y0) else (half, 0)
    quad = [(x0 - ox, y0 - oy), (x1 - ox, y1 - oy), (x1 + ox, y1 + oy), (x0 + ox, y0 + oy)]
    covered = convex_cover(quad[:3], camera.width, camera.height)
    covered |= convex_cover([quad[0], quad[2], quad[3]], camera.width, camera.height)
    start = np.array((camera.fx * p[0][0] / p[0][2] + camera.cx, camera.fy * p[0][1] / p[0][2] + camera.cy))
    end = np.array((camera.fx * p[1][0] / p[1][2] + camera.cx, camera.fy * p[1][1] / p[1][2] + camera.cy))
    along = end - start
    px, py = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    t = ((px - start[0]) * along[0] + (py - start[1]) * along[1]) / max(along @ along, 1e-300)
    t = np.clip(t, 0.0, 1.0)
    return covered, (1.0 - t) / p[0][2] + t / p[1][2]


def _point(p: NDArray[np.float64], size: float, camera: Camera) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    shape = (camera.height, camera.width)
    if not p[2] >= camera.near:
        return np.zeros(shape, dtype=bool), np.zeros(shape)
    x, y = snap(p, camera)
    side = round(max(size, 1.0))
    px = np.arange(camera.width) * 256 + 128
    py = np.arange(camera.height) * 256 + 128
    across = (px >= x - side * 128) & (px < x + side * 128)
    down = (py >= y - side * 128) & (py < y + side * 128)
    return down[:, None] & across[None, :], np.full(shape, 1.0 / p[2])
