"""Small scenes and a camera pose."""

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part, PointCloud, Shape
from gateway.scene.tree.nodes import Node, TreeEdit
from gateway.scene.tree.transforms import look_at, translation
from renderers.drawlist import DrawList, Material
from scenegate.messages.geometry import Box, Cylinder, Sphere


def part(shape: Shape, color: tuple[float, float, float], x: float, y: float, z: float) -> Part:
    return Part(shape, Material((*color, 1.0), metallic=0.0, roughness=0.8), translation(x, y, z))


def scene_of(*parts: Part) -> DrawList:
    """Return the draw list of parts, each with its number as the label."""
    edit = TreeEdit(Node())
    for index, each in enumerate(parts):
        edit.set_parts((index,), (each,))
    return flatten(edit.commit(), label_of=lambda path, _: int(path[-1]))


def table() -> DrawList:
    """Return a floor, a wall and some solids, about 1 to 3 m in front of ``POSE``."""
    parts = (
        part(Box((6.0, 6.0, 0.1)), (0.55, 0.5, 0.45), 0, 0, -0.05),
        part(Box((0.1, 6.0, 4.0)), (0.6, 0.65, 0.7), 1.5, 0, 2.0),
        part(Box((0.3, 0.4, 0.3)), (0.8, 0.3, 0.2), 0.3, 0.35, 0.15),
        part(Sphere(0.2), (0.2, 0.5, 0.8), 0.0, -0.3, 0.2),
        part(Cylinder(0.12, 0.6), (0.3, 0.7, 0.3), 0.6, -0.1, 0.3),
        part(Box((0.1, 0.1, 0.1)), (0.9, 0.8, 0.2), -0.35, 0.1, 0.05),
    )
    return scene_of(*parts)


def dotted_wall() -> DrawList:
    """Return a dark wall with white points, one pixel each at any resolution."""
    y, z = np.meshgrid(np.linspace(-2.0, 2.0, 60), np.linspace(-1.0, 2.0, 60))
    points = np.stack((np.ones(y.size), y.reshape(-1), z.reshape(-1)), axis=1).astype(np.float32)
    cloud = PointCloud(points, {"rgb": np.ones((len(points), 3), np.float32)})
    return scene_of(part(Box((0.1, 20.0, 20.0)), (0.2, 0.2, 0.2), 1.5, 0, 0), part(cloud, (1.0, 1.0, 1.0), 0, 0, 0))


def pose() -> NDArray[np.float64]:
    return look_at((-1.4, 0.0, 0.9), (0.3, 0.0, 0.2), (0.0, 0.0, 1.0))
