"""Meshes of rectangles, heightmaps and camera frustums, with texture coordinates for images."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import Mesh

_CORNERS: Final = np.array(((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)))
"""x and y of a unit square, counter-clockwise from the lower left corner."""


def rectangle(width: float, height: float, repeats: float = 1.0) -> Mesh:
    """Return a rectangle of metres in the plane z = 0, centred on the origin, with an image upright as seen from +z.

    The image's rows run along +x, its top is towards +y; it is repeated along each side.
    """
    positions = np.zeros((4, 3), np.float32)
    positions[:, :2] = _CORNERS * (width, height)
    normals = np.tile(np.array((0.0, 0.0, 1.0), np.float32), (4, 1))
    uv = repeats * np.stack((_CORNERS[:, 0] + 0.5, 0.5 - _CORNERS[:, 1]), axis=1)
    return Mesh(positions, np.array(((0, 1, 2), (0, 2, 3)), np.uint32), normals, uv0=uv.astype(np.float32))


def heightmap_mesh(
    heights: NDArray[np.float32], lengths: tuple[float, float], colors: NDArray[np.float32] | None
) -> Mesh | None:
    """Return the surface z = heights over a rectangle of metres in x and y that is centred on the origin.

    Heights are (R, C), R, C >= 2; x grows with the column, y with the row. Triangles with a height that is not finite
    are left out; None if no triangle is left. Colours are (R * C, 4), linear, row by row. The texture coordinates are
    (0, 0) at the first height and (1, 1) at the last one, so that the first row of an image lies along the first row of
    heights.
    """
    rows, columns = heights.shape
    u, v = np.linspace(0.0, 1.0, columns), np.linspace(0.0, 1.0, rows)
    finite = np.isfinite(heights)
    positions = np.empty((rows, columns, 3), np.float32)
    positions[:, :, 0] = (u - 0.5) * lengths[0]
    positions[:, :, 1] = ((v - 0.5) * lengths[1])[:, None]
    positions[:, :, 2] = np.where(finite, heights, np.float32(0.0))
    uv = np.empty((rows, columns, 2), np.float32)
    uv[:, :, 0], uv[:, :, 1] = u, v[:, None]
    index = np.arange(rows * columns, dtype=np.uint32).reshape(rows, columns)
    lower_left, lower_right, upper_right, upper_left = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    halves_of_cells = (lower_left, lower_right, upper_right, lower_left, upper_right, upper_left)
    triangles = np.stack(halves_of_cells, axis=2).reshape(-1, 3)
    if not finite.all():
        triangles = triangles[finite.reshape(-1)[triangles].all(axis=1)]
    if not len(triangles):
        return None
    normals = _heightmap_normals(positions[:, :, 2], lengths[0] / (columns - 1), lengths[1] / (rows - 1))
    return Mesh(positions.reshape(-1, 3), triangles, normals.reshape(-1, 3), uv0=uv.reshape(-1, 2), colors=colors)


def _heightmap_normals(z: NDArray[np.float32], dx: float, dy: float) -> NDArray[np.float32]:
    """Return the unit normals, (R, C, 3), of heights, (R, C), at distances ``dx`` and ``dy``."""
    normals = np.empty((*z.shape, 3), np.float32)
    z = z.astype(np.float64)
    with np.errstate(all="ignore"):
        slope_y, slope_x = np.gradient(z, dy, dx)
        length = np.sqrt(slope_x * slope_x + slope_y * slope_y + 1.0)
        normals[:, :, 0] = -slope_x / length
        normals[:, :, 1] = -slope_y / length
        normals[:, :, 2] = 1.0 / length
    normals[~np.isfinite(length)] = (0.0, 0.0, 1.0)  # slopes of tiny lengths overflow
    return normals


def frustum_edges(
    width: float, height: float, focal: tuple[float, float], principal: tuple[float, float], depth: float
) -> tuple[Mesh, NDArray[np.float64]]:
    """Return the edges of a camera's frustum as hairlines, in the optical frame (+z forward, +x right, +y down).

    Sizes, fx, fy, cx, cy are in pixels, the depth of the image plane in metres. A triangle above the image's top edge
    marks the upward direction. Also returns the corners of the image plane, (4, 3) metres: top left, top right, bottom
    right, bottom left. They may be infinite or NaN.
    """
    pixels = np.array(((0.0, 0.0), (width, 0.0), (width, height), (0.0, height)))
    corners = np.empty((4, 3))
    corners[:, 2] = depth
    edges_from_camera, edges_of_image = ((0, 1), (0, 2), (0, 3), (0, 4)), ((1, 2), (2, 3), (3, 4), (4, 1))
    edges_of_up_marker = ((1, 5), (5, 2))
    with np.errstate(all="ignore"):  # callers check whether the corners are finite
        corners[:, :2] = (pixels - principal) / focal * depth
        top_left, top_right, bottom_left = corners[0], corners[1], corners[3]
        up_marker = 0.5 * (top_left + top_right) + 0.25 * (top_left - bottom_left)
        positions = np.concatenate((np.zeros((1, 3)), corners, up_marker[None])).astype(np.float32)
    return Mesh(positions, np.array((*edges_from_camera, *edges_of_image, *edges_of_up_marker), np.uint32)), corners
