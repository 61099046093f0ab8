"""Chooses the up axis of a robot's glTF meshes by its collision geometry."""

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from gateway.scene.draw.bounds import Bounds, instance_bounds, union
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node

RobotGltfUp: TypeAlias = Literal["y", "z", "auto"]
"""Up axis of a robot's glTF meshes: ``y`` by the specification, as in Drake and RViz 2; ``auto``: see below."""

LinkParts: TypeAlias = Sequence[tuple[Part, ...]]
"""Parts of each link, in the link's frame."""


def nearest_up_axis(y_up: LinkParts, z_up: LinkParts, collision: LinkParts) -> Literal["y", "z"]:
    """Return the up axis for which the visual geometry's bounds are nearer to those of the collision geometry.

    Boxes are compared by the sum of the absolute differences of their corners. A link without one is skipped.
    """
    differences = {"y": 0.0, "z": 0.0}
    for y_parts, z_parts, collision_parts in zip(y_up, z_up, collision, strict=True):
        expected = _bounds(collision_parts)
        y_box, z_box = _bounds(y_parts), _bounds(z_parts)
        if expected is not None and y_box is not None and z_box is not None:
            differences["y"] += float(np.abs(y_box - expected).sum())
            differences["z"] += float(np.abs(z_box - expected).sum())
    return "z" if differences["z"] < differences["y"] else "y"


def _bounds(parts: tuple[Part, ...]) -> Bounds | None:
    return union([box for box in instance_bounds(flatten(Node(parts)).instances) if box is not None])
