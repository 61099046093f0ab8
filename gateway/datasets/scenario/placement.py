"""Places objects on surfaces without interpenetration.

Objects are unions of convex bodies. Two bodies are apart if their boxes are, or if a plane separates their points by
the gap. The plane is found by Gilbert's algorithm (1966), which approaches the point of the bodies' Minkowski
difference that is nearest to the origin. Undecided pairs count as too near.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.scenario.models import Body
from renderers.stop import check_stop
from scenegate.datasets.boxes import box_corners

_ITERATIONS: Final = 100
"""Maximum number of steps for a pair of bodies. Pairs that are a tenth of their size apart need fewer than 10."""


@dataclass(frozen=True, eq=False)
class CollisionSolid:
    """An object or a part of a surface in the world."""

    bodies: tuple[Body, ...]

    @cached_property
    def boxes(self) -> NDArray[np.float64]:
        """Lowest and highest corner of each body, (N, 2, 3) float64, metres."""
        return np.array([(body.min(axis=0), body.max(axis=0)) for body in self.bodies])

    @cached_property
    def box(self) -> NDArray[np.float64]:
        """Lowest and highest corner of all bodies, (2, 3) float64, metres."""
        return np.array((self.boxes[:, 0].min(axis=0), self.boxes[:, 1].max(axis=0)))

    def moved(self, X: NDArray[np.float64]) -> CollisionSolid:
        """Return the solid moved by a rigid transform."""
        return CollisionSolid(tuple(body @ X[:3, :3].T + X[:3, 3] for body in self.bodies))


def box_solid(X_world_box: NDArray[np.float64], size: tuple[float, float, float]) -> CollisionSolid:
    """Return a box with its centre at the origin of its frame."""
    half = 0.5 * np.array(size)
    return CollisionSolid((box_corners((-half, half)),)).moved(X_world_box)


def are_apart(a: CollisionSolid, b: CollisionSolid, gap: float) -> bool:
    """Return True if two solids are at least ``gap`` metres apart."""
    if _boxes_apart(a.box, b.box, gap):
        return True
    return all(
        _boxes_apart(p_box, q_box, gap) or _bodies_apart(p, q, gap)
        for p, p_box in zip(a.bodies, a.boxes, strict=True)
        for q, q_box in zip(b.bodies, b.boxes, strict=True)
    )


def _boxes_apart(a: NDArray[np.float64], b: NDArray[np.float64], gap: float) -> bool:
    return bool((a[0] > b[1] + gap).any() or (b[0] > a[1] + gap).any())


def _bodies_apart(p: Body, q: Body, gap: float) -> bool:
    """Return True if a plane separates two bodies by the gap.

    ``nearest`` is a point of the Minkowski difference p - q. Each step brings it nearer to the origin, towards the
    corner of the difference that lies farthest in the direction of the origin.
    """
    nearest = p.mean(axis=0) - q.mean(axis=0)
    for _ in range(_ITERATIONS):
        distance = float(np.linalg.norm(nearest))
        if distance <= gap:
            return False
        direction = nearest / distance
        along_p, along_q = p @ direction, q @ direction
        lowest, highest = int(along_p.argmin()), int(along_q.argmax())
        if along_p[lowest] - along_q[highest] > gap:
            return True
        step = p[lowest] - q[highest] - nearest
        length = float(step @ step)
        if length == 0.0:
            return False
        nearest = nearest + min(max(-float(nearest @ step) / length, 0.0), 1.0) * step
    return False


def rotation_of(roll: float, pitch: float, yaw: float) -> NDArray[np.float64]:
    """Return the rotation, (4, 4) float64, by angles in degrees about the fixed x, y and z axes, in this order."""
    X = np.eye(4)
    for axis, degrees in enumerate((roll, pitch, yaw)):
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        about_axis = np.eye(4)
        about_axis[i, i], about_axis[i, j], about_axis[j, i], about_axis[j, j] = c, -s, s, c
        X = about_axis @ X
    return X


def place_on(
    solid: CollisionSolid,
    rotation: NDArray[np.float64],
    X_world_surface: NDArray[np.float64],
    area: tuple[float, float],
    others: list[CollisionSolid],
    gap: float,
    tries: int,
    random: np.random.Generator,
) -> NDArray[np.float64] | None:
    """Return a pose of a solid that stands on a surface, apart from the others; None if none was found.

    ``rotation``: (4, 4), its orientation in the world. ``X_world_surface``: (4, 4), the surface's centre. ``area``:
    sides of the rectangle in which it must lie, metres. The surface itself is not among the others.
    """
    X_surface_object = np.linalg.inv(X_world_surface) @ rotation
    X_surface_object[:3, 3] = 0.0
    low, high = solid.moved(X_surface_object).box  # along the axes of the surface
    room = np.array(area) - (high - low)[:2]
    if (room < 0.0).any():
        return None
    centred = solid.moved(X_world_surface @ X_surface_object)
    """The object in the world with its origin at the centre of the surface. A try only shifts it."""
    centre = X_world_surface[:3, 3]
    box_at_origin = centred.box - centre
    other_boxes = np.array([other.box for other in others]).reshape(-1, 2, 3)
    for _ in range(tries):
        check_stop()
        x, y = random.random(2) * room - 0.5 * np.array(area)  # the box's lowest corner on the surface
        X_surface_object[:3, 3] = (x - low[0], y - low[1], -low[2])
        X_world_object = X_world_surface @ X_surface_object
        box = box_at_origin + X_world_object[:3, 3]
        is_apart = (box[0] > other_boxes[:, 1] + gap).any(axis=1) | (other_boxes[:, 0] > box[1] + gap).any(axis=1)
        near_others = [others[index] for index in np.flatnonzero(~is_apart)]
        if not near_others:
            return X_world_object
        shift = X_world_object[:3, 3] - centre
        placed = CollisionSolid(tuple(body + shift for body in centred.bodies))
        if all(are_apart(placed, other, gap) for other in near_others):
            return X_world_object
    return None
