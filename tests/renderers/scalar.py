"""The rasterizer's arithmetic without SIMD: one vertex, one triangle, one pixel at a time, no binning.

Rounds exactly as the kernels do (same operations in the same order and precision), so results must agree to the last
bit. Triangles only, and none that crosses the near plane or the guard band.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList

f32 = np.float32


@njit
def _vertices(points, X, fx, fy, cx, cy, near):
    out = np.empty((len(points), 3), np.float32)
    for k in range(len(points)):
        x, y, z = np.float64(points[k, 0]), np.float64(points[k, 1]), np.float64(points[k, 2])
        depth = X[2, 0] * x + X[2, 1] * y + X[2, 2] * z + X[2, 3]
        assert depth >= near
        w = 1.0 / depth
        out[k, 0] = fx * (X[0, 0] * x + X[0, 1] * y + X[0, 2] * z + X[0, 3]) * w + cx
        out[k, 1] = fy * (X[1, 0] * x + X[1, 1] * y + X[1, 2] * z + X[1, 3]) * w + cy
        out[k, 2] = w
    return out


@njit
def _covers(x0, y0, x1, y1, x2, y2, px, py):
    """Top-left rule; integers, positive area."""
    inside = True
    for xa, ya, xb, yb in ((x0, y0, x1, y1), (x1, y1, x2, y2), (x2, y2, x0, y0)):
        edge = (xb - xa) * (py - ya) - (yb - ya) * (px - xa)
        if yb < ya or (yb == ya and xb > xa):
            inside = inside and edge >= 0
        else:
            inside = inside and edge > 0
    return inside


@njit
def _centre(v):
    return -((-(v - 128)) // 256)


@njit
def _triangle(a, b, c, record, ids, inverse):
    height, width = ids.shape
    x0, y0 = np.int64(np.rint(a[0] * f32(256))), np.int64(np.rint(a[1] * f32(256)))
    x1, y1 = np.int64(np.rint(b[0] * f32(256))), np.int64(np.rint(b[1] * f32(256)))
    x2, y2 = np.int64(np.rint(c[0] * f32(256))), np.int64(np.rint(c[1] * f32(256)))
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if area == 0:
        return
    left, right = _centre(min(x0, x1, x2)), _centre(max(x0, x1, x2))
    top, bottom = _centre(min(y0, y1, y2)), _centre(max(y0, y1, y2))
    low, high = min(a[2], b[2], c[2]), max(a[2], b[2], c[2])
    large = right - left > 64 or bottom - top > 128 or high > low * f32(4)
    if large and area < 0:
        b, c = c, b
    if area < 0:
        x1, x2, y1, y2 = x2, x1, y2, y1
    ax, ay, aw = np.float64(a[0]), np.float64(a[1]), np.float64(a[2])
    ux, uy, uw = np.float64(b[0]) - ax, np.float64(b[1]) - ay, np.float64(b[2]) - aw
    vx, vy, vw = np.float64(c[0]) - ax, np.float64(c[1]) - ay, np.float64(c[2]) - aw
    determinant = ux * vy - vx * uy
    across = down = 0.0
    if determinant != 0.0:
        if large:
            across = (uw * vy - vw * uy) / determinant
            down = (vw * ux - uw * vx) / determinant
        else:
            reciprocal = 1.0 / determinant
            across = (uw * vy - vw * uy) * reciprocal
            down = (vw * ux - uw * vx) * reciprocal
    base = aw + (across * (np.float64(left) + 0.5 - ax) + down * (np.float64(top) + 0.5 - ay))
    for row in range(max(top, 0), min(bottom, height)):
        for column in range(max(left, 0), min(right, width)):
            if not _covers(x0, y0, x1, y1, x2, y2, 256 * column + 128, 256 * row + 128):
                continue
            if large:
                block = column - column % 8
                start = base + down * np.float64(row - top) + across * np.float64(block - left)
                w = f32(start) + f32(across) * f32(column - block)
            else:
                w = (f32(base) + f32(down) * f32(row - top)) + f32(across) * f32(column - left)
            w = min(max(w, low), high)
            if w > inverse[row, column]:
                inverse[row, column] = w
                ids[row, column] = record


@njit
def _mesh(points, elements, first, ids, inverse):
    for k in range(len(elements)):
        a, b, c = points[elements[k, 0]], points[elements[k, 1]], points[elements[k, 2]]
        _triangle(a, b, c, first + k, ids, inverse)


def draw(scene: DrawList, camera: Camera) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """Records and 1/z as ``Visibility`` has them."""
    ids = np.full((camera.height, camera.width), -1, np.int32)
    inverse = np.full(ids.shape, np.nextafter(f32(1.0 / camera.far), f32(-1.0)), np.float32)
    first = 0
    for instance in scene.instances:
        X = np.matmul(camera.X_camera_world, instance.X_world_mesh[None])[0]
        lens = (camera.fx, camera.fy, camera.cx, camera.cy, camera.near)
        _mesh(_vertices(instance.mesh.positions, X, *lens), instance.mesh.elements, first, ids, inverse)
        first += len(instance.mesh.elements)
    return ids, inverse
