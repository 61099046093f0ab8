"""Values of joints, from the sliders that robots have in the page (``ControlFolder.add_joint_sliders``)."""

from __future__ import annotations

from collections import Counter
from typing import Any, Final

JOINT_UNITS: Final = ("rad", "m")
"""Units of the sliders of joints."""


class Joints:
    """Joints of the page: the sliders in radians or metres, which have the joints' names.

    Joints of several robots that have the same name get those of their folders: ``left/elbow``, ``right/elbow``.
    """

    def __init__(self) -> None:
        self._names: dict[int, str] = {}
        """Names of joints by the ids of their sliders."""
        self._values: dict[int, float] = {}

    @property
    def values(self) -> dict[str, float]:
        """Values of all joints by name."""
        return {name: self._values[slider] for slider, name in self._names.items()}

    def apply(self, header: dict[str, Any]) -> bool:
        """Apply the header of a frame of controls; return True if it changes joints.

        Raises:
            KeyError, TypeError, ValueError: the header is invalid.
        """
        controls = header.get("controls")
        if controls is not None:
            sliders = [each for each in controls if each["type"] == "slider" and each.get("unit") in JOINT_UNITS]
            self._names = _names({each["id"]: tuple(map(str, each["path"])) for each in sliders})
            self._values = {each["id"]: float(each["value"]) for each in sliders}
        changed = {slider: float(value) for slider, value in header["values"] if slider in self._names}
        self._values.update(changed)
        return bool(changed) or controls is not None


def _names(paths: dict[int, tuple[str, ...]]) -> dict[int, str]:
    """Return the names of joints: the last element of a slider's path, or the whole path where that is not unique."""
    counts = Counter(path[-1] for path in paths.values())
    return {slider: path[-1] if counts[path[-1]] == 1 else "/".join(path) for slider, path in paths.items()}
