"""Parts of arrows and coordinate axes. Arrows share unit meshes: when they change, browsers get only matrices."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree.geometry import Part, Surface
from gateway.scene.tree.materials import Color, material
from renderers import primitives
from scenegate.messages.geometry import Cylinder

SIDES: Final = 12
"""Number of sides of an arrow's cylinder and cones. A message may have thousands of arrows a few pixels wide."""


def rotations_from_z(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return rotations, (N, 3, 3), that turn +z to directions, (N, 3), not zero.

    By Duff et al., Building an Orthonormal Basis, Revisited (2017).
    """
    x, y, z = (directions / np.sqrt((directions * directions).sum(axis=1, keepdims=True))).T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    return np.array(
        ((1.0 + sign * x * x * a, b, x), (sign * b, sign + y * y * a, y), (-sign * x, -y, z)), np.float64
    ).transpose(2, 0, 1)


def arrows(
    origins: NDArray[np.float64],
    vectors: NDArray[np.float64],
    lengths: NDArray[np.float64],
    radius: float,
    colors: Sequence[Color],
    *,
    centred: bool,
) -> list[tuple[Part, ...]]:
    """Return arrows as Drake draws contact forces: each is a cylinder with a cone at one or both ends.

    Args:
        origins: (N, 3), points in the world, metres.
        vectors: (N, 3), directions in the world, not zero; their lengths have no effect.
        lengths: (N,), lengths of the cylinders, metres.
        colors: N colours.
        radius: radius of the cylinders, metres. Cones have twice this radius, and twice this radius as length.
        centred: True: an origin is the centre of its cylinder, which has two cones; False: its start, with one cone.
    """
    R, head_size = rotations_from_z(vectors), 2.0 * radius
    begin, end = (-0.5 * lengths, 0.5 * lengths) if centred else (0.0 * lengths, lengths)
    scales = np.empty((len(R), 1, 3))
    scales[:, 0, :2], scales[:, 0, 2] = radius, lengths
    shafts = _transforms(R * scales, origins, R, 0.5 * (begin + end))
    heads = [_transforms(R * head_size, origins, R, end + head_size)]
    if centred:
        turned = R * (head_size, -head_size, -head_size)  # half a turn about x
        heads.append(_transforms(turned, origins, R, begin - head_size))
    shaft, head = Surface(primitives.cylinder(SIDES)), Surface(primitives.cone(SIDES))
    materials = [material(color) for color in colors]
    parts = [
        [Part(shape, color, X, "arrow") for color, X in zip(materials, transforms, strict=True)]
        for shape, transforms in zip((shaft, head, head), (shafts, *heads), strict=False)
    ]
    return list(zip(*parts, strict=True))


def _transforms(
    linear: NDArray[np.float64], origins: NDArray[np.float64], R: NDArray[np.float64], offsets: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return (N, 4, 4) transforms with these linear parts, ``offsets`` metres along z of ``R`` from the origins."""
    X = np.zeros((len(R), 4, 4))
    X[:, :3, :3] = linear
    X[:, :3, 3] = origins + offsets[:, None] * R[:, :, 2]
    X[:, 3, 3] = 1.0
    return X


def triad(length: float, radius: float) -> tuple[Part, ...]:
    """Return three axes from the origin as cylinders: x red, y green, z blue. Lengths in metres."""
    R = rotations_from_z(np.eye(3))
    transforms = _transforms(R, np.zeros((3, 3)), R, np.full(3, 0.5 * length))
    colors: tuple[Color, ...] = ((1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0), (0.0, 0.0, 1.0, 1.0))
    shape = Cylinder(radius, length)
    return tuple(Part(shape, material(color), X, "triad") for color, X in zip(colors, transforms, strict=True))
