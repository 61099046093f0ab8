"""Boxes whose faces show an image each."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

GAZEBO_FACES: Final = np.array(
    [
        [(1, 0, 0), (0, 1, 0), (0, 0, -1)],
        [(-1, 0, 0), (0, -1, 0), (0, 0, -1)],
        [(0, 1, 0), (-1, 0, 0), (0, 0, -1)],
        [(0, -1, 0), (1, 0, 0), (0, 0, -1)],
        [(0, 0, 1), (0, -1, 0), (-1, 0, 0)],
        [(0, 0, -1), (0, -1, 0), (1, 0, 0)],
    ]
)
"""Normal, direction of an image's rows and of its columns, for each face, as Gazebo draws boxes."""
_GAZEBO_PLANE: Final = np.array([[(0, 0, 1), (1, 0, 0), (0, -1, 0)]])
"""The same for its planes."""


class TexturedBox(NamedTuple):
    """Triangles of a box."""

    positions: NDArray[np.float32]
    """(N, 3) metres."""
    triangles: NDArray[np.uint32]
    """(M, 3), anticlockwise from outside."""
    normals: NDArray[np.float32]
    """(N, 3)."""
    uv: NDArray[np.float32]
    """(N, 2); (0, 0) is the image's top left corner."""


def textured_box(half_lengths: NDArray[np.float64], faces: NDArray[np.int64] = GAZEBO_FACES) -> TexturedBox:
    """Return a box with half side lengths (3,), metres; each of its ``faces`` shows a whole image.

    A box without height is Gazebo's plane.
    """
    if half_lengths[2] == 0.0:
        faces = _GAZEBO_PLANE
    steps = np.array(((-1, -1), (-1, 1), (1, 1), (1, -1)))
    normals, rows, columns = (faces[:, each, None] for each in range(3))
    positions = (normals + rows * steps[:, :1] + columns * steps[:, 1:]) * half_lengths
    quads = 4 * np.arange(len(faces))[:, None] + np.arange(4)
    mirrored = np.einsum("ij,ij->i", np.cross(faces[:, 2], faces[:, 1]), faces[:, 0]) < 0
    quads[mirrored] = quads[mirrored, ::-1]
    return TexturedBox(
        positions.reshape(-1, 3).astype(np.float32),
        quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.uint32),
        np.repeat(normals, 4, axis=1).reshape(-1, 3).astype(np.float32),
        np.tile((0.5 + 0.5 * steps).astype(np.float32), (len(faces), 1)),
    )


def obj_file(box: TexturedBox) -> bytes:
    """Return the OBJ file of a box."""
    lines = [f"v {x} {y} {z}" for x, y, z in box.positions.tolist()]
    lines += [f"vt {u} {1.0 - v}" for u, v in box.uv.tolist()]
    lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in (box.triangles + 1).tolist()]
    return "\n".join((*lines, "")).encode()
