"""Controls of one client in the page: ``ControlPanel`` sends them, ``ControlHandle`` has the value of one."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any, Final, Generic, TypeAlias, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from scenegate.messages.changes import Changes, Entry, Path, is_at_or_below
from scenegate.messages.controls import MAX_NUMBER, AnyControl, Button, Gizmo, Slider
from scenegate.robots.robot import Joint
from scenegate.tree.answer import Answer, TreeViewerError
from scenegate.tree.callbacks import CallbackThreads, check_callback
from scenegate.tree.node_handles import PublishedRobot

V = TypeVar("V")
"""Type of a control's value."""
_Handles: TypeAlias = "dict[Path, ControlHandle[Any]]"


class ControlPanel:
    """The controls of one client. It sends them, and receives their values. Thread-safe."""

    def __init__(
        self, send: Callable[[Changes], Answer], threads: CallbackThreads, record: Callable[[Changes], None]
    ) -> None:
        """Send changes with ``send``, which waits for the response; run callbacks in ``threads``.

        ``record`` records changes that are not sent: the page has moved a node.
        """
        self.threads = threads
        self._send = send
        self._record = record
        self.lock = threading.Lock()
        """Guards the handles."""
        self.send_lock = threading.RLock()
        """Held while all controls or clickable paths are sent, so that the newest list arrives last, and in a batch.

        The receiving thread must not wait for it: another thread may hold it while it waits for a response."""
        self._is_batch = False
        """True: the thread that holds ``sending`` collects its controls."""
        self._handles: _Handles = {}

    def definitions(self) -> list[AnyControl]:
        """Return all controls with their current values."""
        with self.lock:
            return [handle.definition() for handle in self._handles.values()]

    def add(self, handles: Sequence[ControlHandle[Any]]) -> None:
        """Show controls, in place of those at their paths."""
        self.threads.start()
        self._replace(lambda old: {**old, **{handle.path: handle for handle in handles}})

    @contextmanager
    def batch(self) -> Iterator[None]:
        """Send what is added and removed inside the context in one request when it ends."""
        with self.send_lock:
            if self._is_batch:
                raise RuntimeError("a batch of controls is open already")
            old = self._handles
            self._is_batch = True
            try:
                yield
                self._is_batch = False
                self._show(old)
            except BaseException:
                with self.lock:
                    self._handles = old
                raise
            finally:
                self._is_batch = False

    def delete(self, top: Path) -> None:
        """Remove the controls at and below a path."""
        self._replace(lambda old: {path: each for path, each in old.items() if not is_at_or_below(path, top)})

    def _replace(self, replacement: Callable[[_Handles], _Handles]) -> None:
        with self.send_lock:
            with self.lock:
                old = self._handles
                self._handles = replacement(old)
            if not self._is_batch:
                self._show(old)

    def _show(self, old: _Handles) -> None:
        """Send all controls, if they are not the old ones, which return if that fails."""
        if self._handles == old:
            return
        try:
            self._send(Changes(controls=self.definitions()))
        except BaseException:
            with self.lock:
                self._handles = old
            raise

    def set_values(self, values: dict[ControlHandle[Any], Any]) -> Answer:
        """Set values in one request. Callbacks are not called."""
        checked = {handle: handle.control.checked(value) for handle, value in values.items()}
        commands = [{"path": handle.path, "value": value} for handle, value in checked.items()]
        with self.lock:
            old = {handle: handle.raw_value for handle in checked}
            for handle, value in checked.items():
                handle.raw_value = value
        try:
            return self._send(Changes(control_values=commands))
        except TreeViewerError:
            with self.lock:
                for handle, value in checked.items():
                    if handle.raw_value is value:
                        handle.raw_value = old[handle]
            raise

    def add_samples(self, path: Path, samples: NDArray[np.float64]) -> Answer:
        """Add samples to a plot."""
        return self._send(Changes(control_values=[{"path": path, "samples": samples}]))

    def sent(self, body: dict[str, Any], utime: int) -> None:
        """Note the time of a request, before it is sent: earlier values from the page are out of date."""
        with self.lock:
            for command in body.get("setvalues", ()):
                if command["path"] in self._handles:
                    self._handles[command["path"]].set_time = utime
            for control in body.get("setcontrols", ()):
                handle = self._handles.get(control.path)
                if handle is not None and not handle.set_time:
                    handle.set_time = utime

    def receive(self, body: dict[str, Any]) -> None:
        """Take the values of a message, and queue the callbacks. Invalid ones are ignored."""
        moved = Changes()
        with self.lock, contextlib.suppress(KeyError, TypeError, ValueError):
            after = int(body["after"])
            for fields in body["controls"]:
                handle = self._handles.get(tuple(fields["path"]))
                if handle is not None and after >= handle.set_time:
                    handle.receive(handle.control.checked(fields["value"]))
                    if isinstance(handle.control, Gizmo):
                        moved.set_entry(handle.control.node, Entry(transform=msgspec.to_builtins(handle.raw_value)))
        if moved.entries:
            self._record(moved)


class ControlHandle(Generic[V]):
    """A control in the page."""

    def __init__(self, panel: ControlPanel, control: AnyControl) -> None:
        self._panel = panel
        self.control = control
        self.raw_value: Any = control.initial
        """Value as in messages."""
        self.set_time = 0
        """``utime`` of the last request that set the value."""
        self._callbacks: list[Callable[[V], Any]] = []
        self._is_queued = False

    @property
    def path(self) -> Path:
        """Names of the folders, and the control's own name."""
        return self.control.path

    @property
    def value(self) -> V:
        """Current value, of the page or of this program. Setting it shows it in all pages; see ``set``."""
        value: V = self._public(self.raw_value)
        return value

    @value.setter
    def value(self, value: V) -> None:
        self.set(value)

    def set(self, value: V) -> Answer:
        """Set the value in all pages. The callbacks of ``on_update`` are not called.

        Raises:
            ValueError: the control cannot have the value.
            TreeViewerError, TimeoutError, ConnectionError: see ``TreeViewer.send``.
        """
        return self._panel.set_values({self: self._message(value)})

    def on_update(self, callback: Callable[[V], Any]) -> Callable[[], None]:
        """Call ``callback`` with the value after each change in a page, or by another program with this control.

        The callbacks run one after the other in a thread of the client, and may use it. If they are slower than the
        changes, they miss values in between, and never the last one.

        Returns:
            Function that ends the calls.
        """
        check_callback(callback, "on_update")
        self._callbacks.append(callback)

        def stop() -> None:
            with contextlib.suppress(ValueError):
                self._callbacks.remove(callback)

        return stop

    def delete(self) -> None:
        """Remove the control from all pages."""
        self._panel.delete(self.path)

    def definition(self) -> AnyControl:
        """Return the control with its current value."""
        has_value = hasattr(self.control, "value")
        return msgspec.structs.replace(self.control, value=self.raw_value) if has_value else self.control

    def receive(self, value: Any) -> None:
        """Take a value of the page, and queue the callbacks. The caller holds the panel's lock."""
        if value == self.raw_value:
            return
        self.raw_value = value
        if not self._is_queued:
            self._is_queued = True
            self._panel.threads.call(self._queue_callbacks)

    def _queue_callbacks(self) -> None:
        with self._panel.lock:
            self._is_queued = False
            value = self.raw_value
        for callback in tuple(self._callbacks):
            self._panel.threads.call(partial(callback, self._public(value)))

    def _message(self, value: Any) -> Any:
        """Return a value as it is sent."""
        return plain(value)

    def _public(self, value: Any) -> Any:
        """Return a value as programs use it."""
        return value


def plain(value: Any) -> Any:
    """Return a NumPy number as a Python number, and other values as they are."""
    return value.item() if isinstance(value, np.generic) else value


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
