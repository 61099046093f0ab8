"""Limits of robot files."""

from __future__ import annotations

from dataclasses import dataclass

from gateway.assets.mesh_formats import MESH_LIMITS
from gateway.gltf import GltfLimits
from gateway.robots.errors import RobotFileError


@dataclass(frozen=True, slots=True)
class RobotLimits:
    """Limits of robot files."""

    max_file_bytes: int = 64 << 20
    """Maximum size of a robot file: that of a humanoid with hands has 0.3 MB. MJCF may contain vertices as text."""
    max_elements: int = 1_000_000
    """Maximum number of XML elements of a robot file, or of an MJCF file with its includes: a humanoid with hands has
    2000. Each costs 100 bytes or more."""
    max_attribute_chars: int = 4096
    """Maximum length of an attribute of a URDF file: names become elements of paths, which have the same limit."""
    max_mesh_bytes: int = 256 << 20
    """Maximum size of a mesh or image file."""
    max_total_bytes: int = 1 << 30
    """Maximum total size of a robot file and the files that it refers to: the largest of 60 robots tried has 60 MB."""
    max_links: int = 10_000
    """Maximum number of links, and of joints: a humanoid with hands has about 100."""
    max_geometries: int = 100_000
    """Maximum number of visual and collision geometries together."""
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


def check_count(count: int, limit: int, what: str) -> None:
    """Check a number of objects in a robot file.

    Args:
        count: Number of objects.
        limit: Maximum number.
        what: Name of the objects, in the plural.

    Raises:
        RobotFileError: There are more than the limit.
    """
    if count > limit:
        raise RobotFileError(f"it has {count} {what}, the limit is {limit}")
