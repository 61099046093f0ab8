"""Texture coordinates of meshes that show a cube map."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.drawlist import Mesh

_FACES: Final = np.array(
    [
        [(1, 0, 0), (0, 0, -1), (0, -1, 0)],
        [(-1, 0, 0), (0, 0, 1), (0, -1, 0)],
        [(0, 1, 0), (1, 0, 0), (0, 0, 1)],
        [(0, -1, 0), (1, 0, 0), (0, 0, -1)],
        [(0, 0, 1), (1, 0, 0), (0, -1, 0)],
        [(0, 0, -1), (-1, 0, 0), (0, -1, 0)],
    ]
)
"""Normal, direction of an image's rows and of its columns, for each face of a cube map, as in OpenGL."""


def cube_mapped(
    mesh: Mesh,
    directions: NDArray[np.floating[Any]],
    texels: int,
    images: int,
    check_vertices: Callable[[int], None],
) -> Mesh:
    """Return a mesh with texture coordinates in a cube map, cut where its triangles meet several faces of the map.

    ``directions``: those in which its vertices are seen from the middle of the map, (N, 3). The map has six ``images``
    in one column, or one for all faces; ``texels``: their side length. Coordinates stay half a texel inside, so that no
    other face shows at edges. ``check_vertices`` gets their number after each cut, and may raise: a triangle around the
    middle becomes some thirty.
    """
    assert mesh.normals is not None
    corners = np.hstack((directions, mesh.positions, mesh.normals)).astype(np.float32)[mesh.elements]
    for first, second in ((0, 1), (1, 2), (2, 0)):
        for sign in (1.0, -1.0):
            corners = _cut(corners, corners[:, :, first] - sign * corners[:, :, second])
            check_vertices(3 * len(corners))
    seen, positions, normals = np.split(corners, 3, axis=2)
    middles = seen.sum(axis=1)
    axes = np.abs(middles).argmax(axis=1)
    faces = 2 * axes + (middles[np.arange(len(axes)), axes] < 0.0)
    with np.errstate(all="ignore"):
        depths, rows, columns = np.einsum("mci,mki->kmc", seen, _FACES[faces])
        uv = np.nan_to_num(np.clip(np.stack((rows, columns), axis=-1) / depths[:, :, None], -1.0, 1.0))
    uv = 0.5 + 0.5 * uv * (1.0 - 1.0 / texels)
    uv[:, :, 1] = (uv[:, :, 1] + (faces % images)[:, None]) / images
    return replace(
        mesh,
        positions=np.ascontiguousarray(positions).reshape(-1, 3),
        elements=np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3),
        normals=np.ascontiguousarray(normals).reshape(-1, 3),
        uv0=uv.reshape(-1, 2).astype(np.float32),
    )


def _cut(corners: NDArray[np.float32], sides: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return triangles, (M, 3, K), of which those on both sides of a plane are cut into three.

    ``sides``: signed distances of the corners from the plane, (M, 3), of any unit.
    """
    above = sides > 0.0
    is_cut = above.any(axis=1) & ~above.all(axis=1)
    cut, sides, above = corners[is_cut], sides[is_cut], above[is_cut]
    # The corner that is alone on its side comes first.
    order = (above != (above.sum(axis=1) == 2)[:, None]).argmax(axis=1)[:, None] + np.arange(3)
    a, b, c = np.take_along_axis(cut, order[:, :, None] % 3, axis=1).swapaxes(0, 1)
    of_a, of_b, of_c = np.take_along_axis(sides, order % 3, axis=1).T[:, :, None]
    ab, ac = _in_plane(a, b, of_a, of_b), _in_plane(a, c, of_a, of_c)
    pieces = np.concatenate([np.stack(each, axis=1) for each in ((a, ab, ac), (ab, b, c), (ab, c, ac))])
    is_flat = (pieces == np.roll(pieces, 1, axis=1)).all(axis=2).any(axis=1)  # a corner lies in the plane
    return np.concatenate((corners[~is_cut], pieces[~is_flat]))


def _in_plane(
    a: NDArray[np.float32], b: NDArray[np.float32], of_a: NDArray[np.float32], of_b: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return the points between a and b in a plane, given both distances from it.

    They are exactly those between b and a: triangles that share an edge share its point.
    """
    is_above = of_a > 0.0
    upper, lower = np.where(is_above, a, b), np.where(is_above, b, a)
    to_lower = np.where(is_above, of_a, of_b) / np.abs(of_a - of_b)
    points: NDArray[np.float32] = upper * (1.0 - to_lower) + lower * to_lower
    return points
