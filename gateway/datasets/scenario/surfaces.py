"""Floors and tables: boxes in the frame of their upper side."""

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.scenario.choices import SurfaceChoice
from gateway.datasets.scenario.drawn_materials import material_of, with_material
from gateway.datasets.scenario.placement import CollisionSolid, box_solid
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node
from gateway.scene.tree.transforms import translation
from scenegate.messages.geometry import Box

PlacedBox = tuple[NDArray[np.float64], tuple[float, float, float]]
"""Pose of a box's centre, (4, 4), and its side lengths in metres."""
FLOOR_THICKNESS: Final = 0.02
TOP_THICKNESS: Final = 0.03
LEG: Final = 0.05
"""Side of a table's leg, metres."""


def boxes_of(surface: SurfaceChoice) -> list[PlacedBox]:
    """Return the boxes of a surface in its frame. A table stands on z = 0; without room for legs it is a shelf."""
    x, y = surface.size
    if surface.kind == "floor":
        return [(translation(0.0, 0.0, -0.5 * FLOOR_THICKNESS), (x, y, FLOOR_THICKNESS))]
    boxes: list[PlacedBox] = [(translation(0.0, 0.0, -0.5 * TOP_THICKNESS), (x, y, TOP_THICKNESS))]
    leg_length = surface.X_world_surface[2][3] - TOP_THICKNESS
    if leg_length > 0.0 and min(x, y) > 2.0 * LEG:
        for side_x, side_y in ((-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)):
            centre = translation(side_x * (x - LEG), side_y * (y - LEG), -TOP_THICKNESS - 0.5 * leg_length)
            boxes.append((centre, (LEG, LEG, leg_length)))
    return boxes


def solids_of(surface: SurfaceChoice) -> list[CollisionSolid]:
    """Return the boxes of a surface in the world, the upper one first."""
    X = np.array(surface.X_world_surface)
    return [box_solid(X @ X_surface_box, size) for X_surface_box, size in boxes_of(surface)]


def node_of(surface: SurfaceChoice, folder: Path) -> Node:
    """Return the node of a surface; raises OSError and ImageError for its texture."""
    material = material_of(surface.material, folder)
    parts = tuple(Part(Box(size), material, X) for X, size in boxes_of(surface))
    return with_material(Node(parts, np.array(surface.X_world_surface)), material, surface.material.texture_size)
