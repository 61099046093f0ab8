"""The error of robot files, and their limits."""

from collections.abc import Sequence
from dataclasses import dataclass

from scenegate.warning_text import joined_warnings


class RobotFileError(ValueError):
    """A robot file cannot be used. The message names the link or joint; ``read_robot`` adds the robot file's name."""


def no_links(warnings: Sequence[str]) -> RobotFileError:
    """Return the error of a robot without links, with the warnings about those that were left out."""
    return RobotFileError(f"it has no links{': ' if warnings else ''}{joined_warnings(warnings)}")


@dataclass(frozen=True, slots=True)
class RobotFileLimits:
    """Limits of robot files and of the files that they refer to."""

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


def check_count(count: int, limit: int, what: str) -> None:
    """Raise RobotFileError if a file has more objects than a limit; ``what`` names them, in the plural."""
    if count > limit:
        raise RobotFileError(f"it has {count} {what}, the limit is {limit}")
