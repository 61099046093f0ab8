"""Parts of arrows and coordinate axes. All share unit meshes, so that browsers get only matrices when arrows change."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.drakeviewer.messages import Vector3
from gateway.scene.geometry import Cylinder, Part, Surface
from gateway.scene.materials import Color, material
from gateway.scene.transforms import scaling, translation
from renderers import primitives

SIDES: Final = 12
"""Number of sides of an arrow's cylinder and cones. A message may have thousands of arrows a few pixels wide."""


def rotation_from_z(direction: Vector3) -> NDArray[np.float64]:
    """Return a rotation that turns +z to ``direction``, which must not be zero, (4, 4) float64."""
    z = _normalized(direction)  # plain numbers: NumPy needs five times as long for single vectors
    smallest = min(range(3), key=lambda axis: abs(z[axis]))
    x = _normalized(_cross((float(smallest == 0), float(smallest == 1), float(smallest == 2)), z))
    X = np.eye(4)
    X[:3, 0], X[:3, 1], X[:3, 2] = x, _cross(z, x), z
    return X


def _normalized(vector: Vector3) -> Vector3:
    x, y, z = vector
    norm = math.hypot(x, y, z)
    return x / norm, y / norm, z / norm


def _cross(a: Vector3, b: Vector3) -> Vector3:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def arrow(
    origin: Vector3, vector: Vector3, length: float, radius: float, color: Color, *, centred: bool
) -> tuple[Part, ...]:
    """Return an arrow along ``vector`` as Drake draws contact forces: a cylinder with a cone at one or both ends.

    Args:
        origin: point in the world, metres.
        vector: direction in the world, not zero; its length has no effect.
        length: length of the cylinder, metres.
        radius: radius of the cylinder, metres. Cones have twice this radius, and twice this radius as length.
        centred: True: ``origin`` is the centre of the cylinder, which has two cones; False: its start, with one cone.
    """
    X_world_arrow = translation(*origin) @ rotation_from_z(vector)
    arrow_material = material(color)
    begin, end = (-0.5 * length, 0.5 * length) if centred else (0.0, length)
    head, shaft = Surface(primitives.cone(SIDES)), Surface(primitives.cylinder(SIDES))
    size = 2.0 * radius
    X_tip_head = scaling(size, size, size)
    X_arrow_shaft = translation(0.0, 0.0, 0.5 * (begin + end)) @ scaling(radius, radius, length)
    tips = [translation(0.0, 0.0, end + size)]
    if centred:
        tips.append(translation(0.0, 0.0, begin - size) @ rotation_from_z((0.0, 0.0, -1.0)))
    body = Part(shaft, arrow_material, X_world_arrow @ X_arrow_shaft, "arrow")
    return (body, *(Part(head, arrow_material, X_world_arrow @ tip @ X_tip_head, "arrow") for tip in tips))


def triad(length: float, radius: float) -> tuple[Part, ...]:
    """Return three axes from the origin as cylinders: x red, y green, z blue. Lengths in metres."""
    parts = []
    for axis in range(3):
        direction = (float(axis == 0), float(axis == 1), float(axis == 2))
        X = rotation_from_z(direction) @ translation(0.0, 0.0, 0.5 * length)
        parts.append(Part(Cylinder(radius, length), material((*direction, 1.0)), X, "triad"))
    return tuple(parts)
