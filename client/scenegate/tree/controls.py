"""Controls in the page: ``TreeViewer.controls``, whose methods add buttons, sliders, plots and others to the panel."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from scenegate.messages import controls as messages
from scenegate.messages.arguments import as_array, describe
from scenegate.messages.changes import Key, Path, path_of
from scenegate.messages.colors import rgba
from scenegate.transforms import from_pose
from scenegate.tree.answer import Answer
from scenegate.tree.callbacks import check_callback
from scenegate.tree.control_panel import ControlHandle, ControlPanel, JointSliders, plain
from scenegate.tree.node_handles import PublishedRobot

MAX_CLICK_CALLS: Final = 100
"""Maximum number of calls of a button's callback for clicks that arrive together."""

MaybePose: TypeAlias = NDArray[np.float64] | None
"""(4, 4) float64 X_parent_node, or None."""
Handle = TypeVar("Handle", bound=ControlHandle[Any])


class ButtonHandle(ControlHandle[int]):
    """A button. Its value is the number of clicks."""

    def on_click(self, callback: Callable[[], Any]) -> Callable[[], None]:
        """Call ``callback`` once for each click, as ``on_update`` does. Returns the function that ends the calls."""
        check_callback(callback, "on_click")
        called_for = self.value

        def call(value: int) -> None:
            nonlocal called_for
            clicks, called_for = value - called_for, value
            for _ in range(min(clicks, MAX_CLICK_CALLS)):
                callback()

        return self.on_update(call)


class ColorHandle(ControlHandle[tuple[float, float, float]]):
    """A field for a colour. Its value is red, green and blue, sRGB from 0 to 1; ``set`` takes all forms of colours."""

    def _message(self, value: Any) -> Any:
        return tuple(rgba(value)[:3])


class GizmoHandle(ControlHandle[MaybePose]):
    """Handles in the view that move and turn a node. The value is X_parent_node, (4, 4), after a drag; None before.

    A gizmo follows its node: a program moves both by the node's transform.
    """

    def set(self, value: MaybePose) -> Answer:
        """Raise ValueError: the pose is that of the node."""
        raise ValueError("a gizmo follows its node: set the node's transform")

    def _public(self, value: Any) -> MaybePose:
        return None if value is None else from_pose(value.translation, value.quaternion)


class PlotHandle(ControlHandle[None]):
    """Curves of values over time."""

    def add(self, *values: float, time_s: float | None = None) -> Answer:
        """Add a sample.

        Args:
            values: a number for each curve; NaN makes a gap.
            time_s: time in seconds, on any clock; None: ``time.time()``. If it goes backwards, the curves start again.
        """
        return self.add_samples([time.time() if time_s is None else time_s], [values])

    def add_samples(self, times: ArrayLike, values: ArrayLike) -> Answer:
        """Add N samples in one request.

        Args:
            times: (N,) seconds, on any clock, in ascending order.
            values: (N, number of curves).
        """
        assert isinstance(self.control, messages.Plot)
        seconds = as_array(times, "times must have numbers", np.float64)
        curves = as_array(values, "values must have numbers", np.float64)
        count = len(self.control.series)
        if curves.ndim == count == 1:
            curves = curves[:, None]
        if seconds.ndim != 1 or curves.shape != (len(seconds), count):
            shapes = f"{seconds.shape} and {curves.shape}"
            raise ValueError(f"times must have shape (N,) and values (N, {count}), not {shapes}")
        return self._panel.add_samples(self.path, self.control.checked_samples(np.column_stack((seconds, curves))))


class ControlFolder:
    """A folder of the panel. Indexing gives the folders below: ``viewer.controls["arm"]``. Names may be ``arm/speed``.

    A control that is added at the path of an earlier one replaces it. All methods raise ValueError for an invalid
    argument, and the errors of ``TreeViewer.send``.
    """

    def __init__(self, panel: ControlPanel, path: Path = ()) -> None:
        self.panel = panel
        self.path = path

    def __getitem__(self, key: Key) -> ControlFolder:
        return ControlFolder(self.panel, self.path + path_of(key))

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Show the controls that this thread adds inside the context in one request when it ends.

        Each request has all controls of the program: 1000 that are added one by one take seconds. Values can be set
        afterwards. An exception adds nothing. Other threads that add controls wait.
        """
        with self.panel.batch():
            yield

    def delete(self) -> None:
        """Remove all controls of this program in the folder."""
        self.panel.delete(self.path)

    def _path(self, name: Key) -> Path:
        return self.path + path_of(name)

    def _shown(self, handle: Handle) -> Handle:
        self.panel.add([handle])
        return handle

    def add_button(self, name: Key) -> ButtonHandle:
        """Add a button."""
        return self._shown(ButtonHandle(self.panel, messages.Button(self._path(name))))

    def add_slider(
        self,
        name: Key,
        min: float,  # noqa: A002 - as in other viewers
        max: float,  # noqa: A002 - the word of sliders everywhere
        *,
        value: float | None = None,
        step: float | None = None,
        unit: str = "",
    ) -> ControlHandle[float]:
        """Add a slider.

        Args:
            name: name, or path in this folder.
            min: lowest value.
            max: highest value.
            value: value at first; None: the lowest.
            step: distance between values; None: any value.
            unit: text behind the value.
        """
        slider = messages.Slider(
            self._path(name), plain(min), plain(max), value=plain(value), step=plain(step), unit=unit
        )
        return self._shown(ControlHandle[float](self.panel, slider))

    def add_number(
        self,
        name: Key,
        value: float = 0.0,
        *,
        min: float | None = None,  # noqa: A002 - the word of sliders everywhere
        max: float | None = None,  # noqa: A002 - the word of sliders everywhere
        step: float | None = None,
        unit: str = "",
    ) -> ControlHandle[float]:
        """Add a field for a number. See ``add_slider``."""
        number = messages.NumberInput(self._path(name), plain(value), plain(min), plain(max), plain(step), unit)
        return self._shown(ControlHandle[float](self.panel, number))

    def add_text(self, name: Key, value: str = "") -> ControlHandle[str]:
        """Add a field for a line of text."""
        text = messages.TextInput(self._path(name), value=value)
        return self._shown(ControlHandle[str](self.panel, text))

    def add_checkbox(self, name: Key, value: bool = False) -> ControlHandle[bool]:
        """Add a check box."""
        checkbox = messages.Checkbox(self._path(name), value=plain(value))
        return self._shown(ControlHandle[bool](self.panel, checkbox))

    def add_dropdown(self, name: Key, options: Sequence[str], value: str | None = None) -> ControlHandle[str]:
        """Add a menu; the first of the options is chosen if there is no value."""
        dropdown = messages.Dropdown(self._path(name), _texts(options), value=value)
        return self._shown(ControlHandle[str](self.panel, dropdown))

    def add_color(self, name: Key, value: ArrayLike = (1.0, 1.0, 1.0)) -> ColorHandle:
        """Add a field for a colour, which is given as ``color`` of geometry, without alpha."""
        red, green, blue = rgba(value)[:3]
        return self._shown(ColorHandle(self.panel, messages.ColorInput(self._path(name), value=(red, green, blue))))

    def add_plot(self, name: Key, *series: str, seconds: float = 30.0, unit: str = "") -> PlotHandle:
        """Add a plot.

        Args:
            name: name, or path in this folder.
            series: names of the curves.
            seconds: length of the time axis.
            unit: unit of the values.
        """
        plot = messages.Plot(self._path(name), series, seconds=plain(seconds), unit=unit)
        return self._shown(PlotHandle(self.panel, plot))

    def add_gizmo(self, name: Key, node: Key) -> GizmoHandle:
        """Add handles in the view that move and turn a node, and fields for its pose in the panel."""
        gizmo = messages.Gizmo(self._path(name), path_of(node))
        return self._shown(GizmoHandle(self.panel, gizmo))

    def add_joint_sliders(self, robot: PublishedRobot, name: Key | None = None) -> JointSliders:
        """Add a folder with a slider for each joint of a robot, which moves it, and a button that resets them.

        Args:
            robot: result of ``TreeViewer.robot``.
            name: name of the folder; None: the robot's path.
        """
        if not isinstance(robot, PublishedRobot):
            raise ValueError(f"robot must be the result of TreeViewer.robot, not {describe(robot)}")
        folder = ("/".join(map(str, robot.path)),) if name is None else path_of(name)
        return JointSliders(self.panel, self.path + folder, robot)


def _texts(options: Sequence[str]) -> tuple[str, ...]:
    """Return a list as tuple, and what is no list as it is, for the error of ``messages.Dropdown``."""
    if isinstance(options, str) or not isinstance(options, Iterable):
        return options  # type: ignore[return-value]  # the caller's error
    return tuple(options)
