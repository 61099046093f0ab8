"""A robot with parts of the scene as its geometry."""

from collections.abc import Mapping

from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, PathElement
from scenegate.robots import robot


class Robot(robot.Robot[Part]):
    """A robot whose geometry is parts of the scene."""

    __slots__ = ()

    def tree(self, values: Mapping[str, robot.JointValue]) -> Node:
        """Return a tree with a node for each link, below a node with the robot's name. See ``link_poses``."""
        poses = self.link_poses(values)
        links: dict[PathElement, Node] = {
            name: Node(parts, X) for name, parts, X in zip(self.links, self.parts, poses, strict=True)
        }
        return Node(None, children={self.name: Node(None, children=links)})
