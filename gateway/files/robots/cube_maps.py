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


_IN_PLANE: Final = 1e-4
"""Distance from a plane, of that from the middle, below which a corner lies in it: no thin triangles are cut off."""
_MAX_ERROR: Final = 0.005
"""Maximum error of the place in an image at the middle of an edge, of the image's side length."""
_MAX_HALVINGS: Final = 10
"""Maximum number of times that a triangle is halved: those that touch the middle of the map have no end."""


def cube_mapped(
    mesh: Mesh, directions: NDArray[np.floating[Any]], texels: int, images: int, check_vertices: Callable[[int], None]
) -> Mesh:
    """Return a mesh with texture coordinates in a cube map, cut where its triangles meet several faces of the map.

    Triangles that are long for their distance from the middle are cut, too.

    ``directions``: those in which its vertices are seen from the middle of the map, (N, 3). The map has six ``images``
    in one column, or one for all faces; ``texels``: their side length. Coordinates stay half a texel inside, so that no
    other face shows at edges. ``check_vertices`` gets their number after each cut, and may raise: a triangle around the
    middle becomes hundreds.
    """
    assert mesh.normals is not None
    corners = np.hstack((directions, mesh.positions, mesh.normals)).astype(np.float32)[mesh.elements]
    for first, second in ((0, 1), (1, 2), (2, 0)):
        for sign in (1.0, -1.0):
            sides = corners[:, :, first] - sign * corners[:, :, second]
            sides[np.abs(sides) < _IN_PLANE * np.abs(corners[:, :, :3]).max(axis=2)] = 0.0
            corners = _cut(corners, sides)
            check_vertices(3 * len(corners))
    middles = corners[:, :, :3].sum(axis=1)
    axes = np.abs(middles).argmax(axis=1)
    faces = 2 * axes + (middles[np.arange(len(axes)), axes] < 0.0)
    for _ in range(_MAX_HALVINGS):
        halves = _halved(corners, *_seen_on_faces(corners, faces))
        if halves is None:
            break
        corners, halved = halves
        faces = faces[halved]
        check_vertices(3 * len(corners))
    uv, _ = _seen_on_faces(corners, faces)
    _, positions, normals = np.split(corners, 3, axis=2)
    uv = 0.5 + 0.5 * uv * (1.0 - 1.0 / texels)
    uv[:, :, 1] = (uv[:, :, 1] + (faces % images)[:, None]) / images
    return replace(
        mesh,
        positions=np.ascontiguousarray(positions).reshape(-1, 3),
        elements=np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3),
        normals=np.ascontiguousarray(normals).reshape(-1, 3),
        uv0=uv.reshape(-1, 2).astype(np.float32),
    )


def _seen_on_faces(
    corners: NDArray[np.float32], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return places on the faces of the map, (M, 3, 2) from -1 to 1, and depths along the faces' normals, (M, 3)."""
    with np.errstate(all="ignore"):
        depths, rows, columns = np.einsum("mci,mki->kmc", corners[:, :, :3], _FACES[faces])
        places = np.nan_to_num(np.clip(np.stack((rows, columns), axis=-1) / depths[:, :, None], -1.0, 1.0))
    return places, depths


def _halved(
    corners: NDArray[np.float32], places: NDArray[np.float64], depths: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.int64]] | None:
    """Return triangles of which those are halved whose error is above ``_MAX_ERROR``; None if there are none.

    A place is a quotient by the depth, which is not linear along an edge. Whether an edge is halved depends on its two
    ends only, so that both its triangles get the same corners in the end.

    Returns:
        Triangles, and the row of each among those given.
    """
    with np.errstate(all="ignore"):
        bend = np.abs(depths - np.roll(depths, -1, axis=1)) / np.abs(depths + np.roll(depths, -1, axis=1))
        errors = np.nan_to_num(0.25 * np.abs(places - np.roll(places, -1, axis=1)).max(axis=2) * bend, posinf=1.0)
    worst = errors.argmax(axis=1)
    is_halved = errors.max(axis=1) > _MAX_ERROR
    if not is_halved.any():
        return None
    order = (worst[is_halved, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(corners[is_halved], order[:, :, None], axis=1).swapaxes(0, 1)
    middle = 0.5 * (a + b)
    halves = np.stack((a, middle, c), axis=1), np.stack((middle, b, c), axis=1)
    rows = np.flatnonzero(is_halved)
    return np.concatenate((corners[~is_halved], *halves)), np.concatenate((np.flatnonzero(~is_halved), rows, rows))


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
