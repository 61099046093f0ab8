"""Limits of robot files that the server reads: those of the client, of the programs that it runs, and of meshes."""

from dataclasses import dataclass

from gateway.files.assets.mesh_formats import MESH_LIMITS
from gateway.files.gltf import GltfLimits
from scenegate.robots.robot_limits import RobotFileLimits


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
