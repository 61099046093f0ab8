"""Arrows and triads of shared unit meshes, so that browsers get only their matrices when they change."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gateway.drakeviewer.messages import Vector3
from gateway.scene.geometry import Cylinder, Part, Surface
from gateway.scene.materials import Color, material
from gateway.scene.transforms import scaling, translation
from renderers import primitives


def along(direction: Vector3) -> NDArray[np.float64]:
    """Return a rotation whose +z axis is ``direction``, (4, 4) float64."""
    z = np.array(direction, dtype=np.float64) / math.hypot(*direction)
    x = np.cross(np.eye(3)[int(np.abs(z).argmin())], z)
    x /= np.linalg.norm(x)
    X = np.eye(4)
    X[:3, :3] = np.column_stack((x, np.cross(z, x), z))
    return X


def arrow(
    origin: Vector3, vector: Vector3, length: float, radius: float, color: Color, *, centred: bool
) -> tuple[Part, ...]:
    """Return an arrow along ``vector`` as Drake draws contact forces: heads are added to the length.

    Args:
        length: length of the shaft, metres.
        radius: radius of the shaft; heads have twice the radius, and a length of twice the radius.
        centred: True: ``origin`` is the centre of the shaft, which has two heads; False: its start, with one head.
    """
    X_world_arrow = translation(*origin) @ along(vector)
    paint = material(color)
    begin, end = (-0.5 * length, 0.5 * length) if centred else (0.0, length)
    head = Surface(primitives.cone())
    size = 2.0 * radius
    to_head = scaling(size, size, size)
    shaft = Part(Cylinder(radius, length), paint, X_world_arrow @ translation(0.0, 0.0, 0.5 * (begin + end)), "arrow")
    tips = [translation(0.0, 0.0, end + size)]
    if centred:
        tips.append(translation(0.0, 0.0, begin - size) @ along((0.0, 0.0, -1.0)))
    return (shaft, *(Part(head, paint, X_world_arrow @ tip @ to_head, "arrow") for tip in tips))


def triad(length: float, radius: float) -> tuple[Part, ...]:
    """Return three axes from the origin as cylinders: x red, y green, z blue."""
    parts = []
    for axis in range(3):
        direction = (float(axis == 0), float(axis == 1), float(axis == 2))
        X = along(direction) @ translation(0.0, 0.0, 0.5 * length)
        parts.append(Part(Cylinder(radius, length), material((*direction, 1.0)), X, "triad"))
    return tuple(parts)
