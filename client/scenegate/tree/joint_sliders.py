"""Sliders of a robot's joints in the page. ``ControlFolder.add_joint_sliders`` makes them."""

import math
from collections.abc import Mapping
from functools import partial
from typing import Final

from scenegate.messages.changes import Path
from scenegate.messages.controls import MAX_NUMBER, Button, Slider
from scenegate.robots.robot import Joint
from scenegate.tree.control_panel import ControlHandle, ControlPanel
from scenegate.tree.published_robot import PublishedRobot

UNLIMITED: Final[Mapping[str, float]] = {"revolute": math.pi, "prismatic": 1.0}
"""Largest value of the slider of a joint without limits, in radians or metres."""
RESET: Final = "Reset"
"""Name of the button that sets the first values."""


class JointSliders:
    """A slider for each joint with one value, except those that follow others, and a button ``Reset``."""

    def __init__(self, panel: ControlPanel, folder: Path, robot: PublishedRobot) -> None:
        """Show the sliders, with the robot's values."""
        self._panel = panel
        self._robot = robot
        self._folder = folder
        self._first_values = {
            name: value[0]
            for name, value in robot.joint_values.items()
            if len(value) == 1 and robot.joints[name].mimic is None
        }
        self.sliders: dict[str, ControlHandle[float]] = {}
        """Sliders by the names of their joints."""
        for name, value in self._first_values.items():
            joint = robot.joints[name]
            low, high = _range(joint, value)
            slider = Slider((*folder, name), low, high, value=value, unit=joint.unit)
            self.sliders[name] = ControlHandle(panel, slider)
            self.sliders[name].on_update(partial(self._move, name))
        reset: ControlHandle[int] = ControlHandle(panel, Button((*folder, RESET)))
        reset.on_update(lambda clicks: self.reset())
        if self.sliders:
            panel.add([*self.sliders.values(), reset])

    @property
    def values(self) -> dict[str, float]:
        """Values of the sliders by the names of their joints, in radians or metres."""
        return {name: slider.value for name, slider in self.sliders.items()}

    def set(self, values: Mapping[str, float]) -> None:
        """Move the robot and its sliders. A slider stays at its limit for a value beyond it.

        Raises:
            ValueError, TreeViewerError, TimeoutError, ConnectionError: see ``PublishedRobot.set_joints``.
        """
        self._robot.set_joints(values)
        shown = {}
        for name, value in values.items():
            if (slider := self.sliders.get(name)) is not None and isinstance(slider.control, Slider):
                shown[slider] = min(max(float(value), slider.control.min), slider.control.max)
        self._panel.set_values(shown)

    def reset(self) -> None:
        """Set the values that the robot had when the sliders were added."""
        self.set(self._first_values)

    def delete(self) -> None:
        """Remove the sliders. The robot stays."""
        self._panel.delete(self._folder)

    def _move(self, name: str, value: float) -> None:
        self._robot.set_joints({name: value})


def _range(joint: Joint, value: float) -> tuple[float, float]:
    """Return the limits of a slider. They include the value, which the file or a program may have set beyond.

    Raises ValueError if it is beyond ``MAX_NUMBER``.
    """
    if abs(value) > MAX_NUMBER:
        raise ValueError(f"joint {joint.name!r} has the value {value:g}, the limit of a slider is {MAX_NUMBER:g}")
    low, high = joint.limits or (0.0, 0.0)
    if not (low < high and max(abs(low), abs(high)) < MAX_NUMBER):
        high = UNLIMITED[joint.kind]
        low = -high
    return min(low, value), max(high, value)
