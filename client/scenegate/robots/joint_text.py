"""Joint values as users write them on a command line: ``elbow=1.2``, ``base=0,0,1,1,0,0,0``."""

from collections.abc import Iterable

from scenegate.robots.robot_errors import RobotFileError


def parse_joints(texts: Iterable[str]) -> dict[str, tuple[float, ...]]:
    """Return the values by joint name, from texts such as ``elbow=1.2``.

    Raises RobotFileError if a text is not ``name=number`` or ``name=number,number,…``, or a name appears twice.
    """
    values: dict[str, tuple[float, ...]] = {}
    for text in texts:
        name, separator, numbers = text.rpartition("=")
        try:
            value = tuple(float(number) for number in numbers.split(","))
        except ValueError:
            value = ()
        if not separator or not name.strip() or not value:
            raise RobotFileError(f"--joint {text!r}: must be name=value, such as elbow=1.2 (radians or metres)")
        if name.strip() in values:
            raise RobotFileError(f"--joint {text!r}: {name.strip()} has a value already")
        values[name.strip()] = value
    return values
