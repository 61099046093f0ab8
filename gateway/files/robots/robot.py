"""A robot with parts of the scene as its geometry, and the limits of the files of one."""

from collections.abc import Mapping
from dataclasses import dataclass

from gateway.files.assets.mesh_formats import MESH_LIMITS
from gateway.files.gltf import GltfLimits
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, PathElement
from scenegate.robots import robot
from scenegate.robots.robot_errors import RobotFileLimits


@dataclass(frozen=True, slots=True)
class RobotLimits(RobotFileLimits):
    """Limits of robot files."""

    max_compiler_bytes: int = 8 << 30
    """Address space of the process in which MuJoCo compiles an MJCF file, where the system can limit it. Of 38 files
    tried, the largest reserves 3.5 GB; none uses more than 0.7 GB."""
    max_compiler_seconds: int = 120
    """Seconds of CPU time for which that process may run: the slowest of these files takes 3 s."""
    max_model_bytes: int = 1 << 30
    """Maximum size of the compiled model of an MJCF file."""
    max_xacro_bytes: int = 1 << 30
    """Address space of the process in which xacro expands a file: robots need less than 0.1 GB."""
    max_xacro_seconds: int = 60
    """Seconds of CPU time for which that process may run: robots take less than 2."""
    mesh: GltfLimits = MESH_LIMITS
    """Limits of the content of each mesh file."""


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
