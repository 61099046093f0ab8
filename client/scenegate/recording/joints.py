"""Values of joints, from the sliders that robots have in the page (``ControlFolder.add_joint_sliders``)."""

from __future__ import annotations

from collections import Counter
from typing import Final

from scenegate.recording.values import JointValues
from scenegate.recording.view_frames import ViewFrame, ViewFrameError

JOINT_UNITS: Final = ("rad", "m")
"""Units of the sliders of joints."""


class JointReader:
    """Reads the frames of controls. A slider in radians or metres is a joint; its name is the joint's.

    Joints of several robots that have the same name get those of their folders: ``left/elbow``, ``right/elbow``.
    """

    def __init__(self) -> None:
        self._names: dict[int, str] = {}
        """Names of joints by the ids of their sliders."""
        self._values: dict[int, float] = {}

    @property
    def has_joints(self) -> bool:
        """True if there are sliders of joints."""
        return bool(self._values)

    def read(self, frame: ViewFrame, time: int) -> JointValues | None:
        """Return the values of all joints if a frame changes them, else None.

        Args:
            time: time of the values, nanoseconds since the epoch.

        Raises:
            ViewFrameError: the frame is invalid.
        """
        header = frame.header
        if header.get("kind") != "controls":
            return None
        try:
            if header.get("controls") is not None:
                sliders = {
                    each["id"]: each
                    for each in header["controls"]
                    if each["type"] == "slider" and each.get("unit") in JOINT_UNITS
                }
                self._names = _names({slider_id: tuple(map(str, each["path"])) for slider_id, each in sliders.items()})
                self._values = {slider_id: float(each["value"]) for slider_id, each in sliders.items()}
            changed = {number: value for number, value in header["values"] if number in self._names}
            self._values.update({number: float(value) for number, value in changed.items()})
        except (KeyError, TypeError, ValueError) as error:
            raise ViewFrameError(f"a frame of controls is invalid: {error!r}") from None
        if not self._values or (header.get("controls") is None and not changed):
            return None
        return JointValues(time, {name: self._values[number] for number, name in self._names.items()})


def _names(paths: dict[int, tuple[str, ...]]) -> dict[int, str]:
    """Return the names of joints: the last element of a slider's path, or the whole path where that is not unique."""
    counts = Counter(path[-1] for path in paths.values())
    return {number: path[-1] if counts[path[-1]] == 1 else "/".join(path) for number, path in paths.items()}
