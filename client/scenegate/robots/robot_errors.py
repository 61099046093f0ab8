"""The error of robot files."""

from collections.abc import Sequence

from scenegate.warning_text import joined_warnings


class RobotFileError(ValueError):
    """A robot file cannot be used. The message names the link or joint; ``read_robot`` adds the robot file's name."""


def no_links(warnings: Sequence[str]) -> RobotFileError:
    """Return the error of a robot without links, with the warnings about those that were left out."""
    return RobotFileError(f"it has no links{': ' if warnings else ''}{joined_warnings(warnings)}")
