"""Controls that programs show in the page: buttons, sliders, plots and others, by path.

A client sends all of its controls, and repeats that before ``lease_seconds`` are over; those of a client that has
vanished are removed. Clients that set the same path share the control: all of them get its values, and it has the
limits of the client that added or changed it last.
"""

import contextlib
import time
from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree.nodes import Path
from scenegate.messages.controls import MAX_SAMPLES, AnyControl, Button, Gizmo, Plot, Value

Deliver = Callable[[Sequence[tuple[Path, Value]], int], None]
"""Sends values of controls to a client, and the number of its last request that was executed before."""


@dataclass(frozen=True, slots=True)
class ControlLimits:
    """Limits of the controls in the page. A command beyond a limit fails."""

    clients: int = 64
    """Maximum number of clients that have controls."""
    controls: int = 1000
    """Maximum number of controls of all clients: every page shows all of them."""
    plots: int = 50
    """Maximum number of plots of all clients: each has up to 200 kB of samples, which every page gets."""
    option_chars: int = 200_000
    """Maximum number of characters in the paths, options and curves of one client, for the same reason."""
    lease_seconds: float = 30.0
    """Time after which the controls of a client that has not repeated them are removed."""


@dataclass(slots=True, eq=False)
class ControlEntry:
    """A control that pages show."""

    id: int
    """Its number in messages of the page. A control of another type gets a new one."""
    control: AnyControl
    value: Value
    revision: int
    """Revision of the value."""
    samples: NDArray[np.float64] | None
    """A plot's samples, a row for each: its revision, its time in seconds and the values. None: no plot."""


@dataclass(slots=True)
class _Client:
    controls: dict[Path, AnyControl]
    """Controls as the client has defined them."""
    deliver: Deliver
    end: float
    """Time of the clock at which the lease ends."""
    last_request: int
    """Number of its last request."""
    unsent: dict[Path, None] = field(default_factory=dict)
    """Paths whose values ``deliver_values`` sends."""


class ControlStore:
    """The controls of all clients. Not thread-safe: it is used in the event loop's thread only."""

    def __init__(self, limits: ControlLimits | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.limits = limits or ControlLimits()
        self.revision = 0
        """Number of changes so far."""
        self._clock = clock
        self._entries: dict[Path, ControlEntry] = {}
        self._by_id: dict[int, ControlEntry] = {}
        self.clients: dict[Hashable, _Client] = {}
        """Clients that have controls."""
        self._structure_revision = 0
        """Revision of the last change of other things than values and samples."""
        self._last_id = 0
        self._listeners: list[Callable[[], None]] = []

    def listen(self, listener: Callable[[], None]) -> None:
        """Register a listener that is called after every change. It must not block."""
        self._listeners.append(listener)

    def set_controls(self, client: Hashable, controls: Sequence[AnyControl], deliver: Deliver, request: int) -> str:
        """Replace the controls of a client; none: it is forgotten. Earlier ones keep values and samples.

        ``deliver`` is called with changes of values that others have made, and must not block. ``request`` is a number
        that increases. Returns the reason of a refusal, which changes nothing, or an empty string.
        """
        self.remove_vanished()
        paths = {control.path: control for control in controls}
        reason = self._refusal(client, controls, paths)
        if reason:
            return reason
        end = self._clock() + self.limits.lease_seconds
        old_client = self.clients.get(client)
        if paths:
            self.clients[client] = _Client(paths, deliver, end, request)
        else:
            self.clients.pop(client, None)
        old_controls = old_client.controls if old_client is not None else {}
        for control in controls:
            self._add(control, client, old_controls.get(control.path))
        self._remove_unused(old_controls)
        if old_client is not None and paths:  # a message may have been lost
            self.clients[client].unsent = {path: None for path in paths if path in old_controls}
        self._notify()
        return ""

    def _refusal(self, client: Hashable, controls: Sequence[AnyControl], paths: dict[Path, AnyControl]) -> str:
        """Return the reason why a client cannot have controls, or an empty string."""
        limits = self.limits
        if len(paths) < len(controls):
            return "two controls have the same path"
        others_paths = {path for key, other in self.clients.items() if key != client for path in other.controls}
        control_count = len(others_paths | paths.keys())
        if control_count > limits.controls:
            return f"there would be {control_count} controls in the page, the limit is {limits.controls}"
        plot_paths = {control.path for control in controls if isinstance(control, Plot)}
        plot_paths |= {path for path in others_paths - paths.keys() if self._entries[path].samples is not None}
        if len(plot_paths) > limits.plots:
            return f"there would be {len(plot_paths)} plots in the page, the limit is {limits.plots}"
        chars = sum(_text_chars(control) for control in controls)
        if chars > limits.option_chars:
            return f"the controls have {chars} characters, the limit for one client is {limits.option_chars}"
        if paths and client not in self.clients and len(self.clients) >= limits.clients:
            return f"{len(self.clients)} clients have controls, which is the limit"
        return ""

    def _add(self, control: AnyControl, client: Hashable, before: AnyControl | None) -> None:
        """Add a control, or change the one at its path. ``before``: as the client has defined it; None: it is new."""
        if before is not None and _definition(before) == _definition(control):  # most are repeated
            return
        entry = self._entries.get(control.path)
        if entry is None or _kind(entry.control) != _kind(control):
            self._create(control)
            return
        if _definition(entry.control) != _definition(control):
            self._next_structure()
        entry.control = control
        value = control.initial
        sets_value = before is None and getattr(control, "value", None) is not None
        if not sets_value and entry.value is not None:
            with contextlib.suppress(ValueError):  # beyond the new limits
                value = control.checked(entry.value)
        if value != entry.value:
            self._change(entry, value, client)

    def _create(self, control: AnyControl) -> None:
        """Add a control in place of the one at its path."""
        old = self._entries.get(control.path)
        if old is not None:
            del self._by_id[old.id]
        self._last_id += 1
        samples = np.empty((0, 2 + len(control.series))) if isinstance(control, Plot) else None
        entry = ControlEntry(self._last_id, control, control.initial, self._next_structure(), samples)
        self._entries[control.path] = self._by_id[entry.id] = entry

    def _remove_unused(self, paths: Iterable[Path]) -> None:
        """Remove those of the paths that no client has; the others have the limits of a client that has them."""
        for path in paths:
            remaining = [client.controls[path] for client in self.clients.values() if path in client.controls]
            entry = self._entries[path]
            if not remaining:
                del self._by_id[self._entries.pop(path).id]
                self._next_structure()
            elif all(_definition(control) != _definition(entry.control) for control in remaining):
                self._add(remaining[-1], None, entry.control)

    def remove_vanished(self) -> None:
        """Remove the controls of clients whose lease has ended."""
        now = self._clock()
        self.forget(lambda client: self.clients[client].end < now)

    def forget(self, is_gone: Callable[[Hashable], bool]) -> None:
        """Remove the controls of clients that have disconnected."""
        gone_clients = [client for client in self.clients if is_gone(client)]
        for client in gone_clients:
            self._remove_unused(self.clients.pop(client).controls)
        if gone_clients:
            self._notify()

    def set_value(self, client: Hashable, path: Path, value: Any, request: int) -> None:
        """Set the value of a client's control. Raises ValueError if there is none, or it cannot have the value."""
        entry = self._entry_of(client, path, request)
        if isinstance(entry.control, Gizmo):
            raise ValueError("a gizmo has the pose of its node; settransform moves both")
        self._change(entry, entry.control.checked(value), client)
        self._notify()

    def add_samples(self, client: Hashable, path: Path, samples: NDArray[np.float64], request: int) -> None:
        """Add samples, (N, 1 + curves), of time in seconds and values to a client's plot. Raises ValueError.

        The earlier ones are dropped where the time goes backwards.
        """
        entry = self._entry_of(client, path, request)
        if not isinstance(entry.control, Plot) or entry.samples is None:
            kind = type(entry.control).__struct_config__.tag
            raise ValueError(f"samples can be added to a plot, not to a {kind}")
        checked = entry.control.checked_samples(samples)
        self.revision += 1
        rows = np.concatenate([entry.samples, np.insert(checked, 0, self.revision, axis=1)])
        restarts = np.flatnonzero(np.diff(rows[:, 1]) < 0.0)
        entry.samples = rows[restarts[-1] + 1 if restarts.size else 0 :][-MAX_SAMPLES:]
        self._notify()

    def _entry_of(self, client: Hashable, path: Path, request: int) -> ControlEntry:
        """Return a client's control, and note its request."""
        owner = self.clients.get(client)
        if owner is None or path not in owner.controls:
            raise ValueError("this client has no such control; setcontrols adds it")
        owner.last_request = max(owner.last_request, request)
        return self._entries[path]

    def change(self, control_id: int, value: Any) -> ControlEntry | None:
        """Change a value in the page; a button counts a click. Return the control; None if there is no such one.

        A value that the control cannot have changes nothing, and the pages get the old one again.
        """
        entry = self._by_id.get(control_id)
        if entry is None or isinstance(entry.control, Plot):
            return None
        if isinstance(entry.control, Button):
            value = (entry.value if isinstance(entry.value, int) else 0) + 1
        with contextlib.suppress(ValueError):
            entry.value = entry.control.checked(value)
        self._change(entry, entry.value, None)
        self._notify()
        return entry

    def _change(self, entry: ControlEntry, value: Value, source: Hashable) -> None:
        """Set a value, and note it for all clients but its source."""
        self.revision += 1
        entry.value, entry.revision = value, self.revision
        path = entry.control.path
        for key, client in self.clients.items():
            if key != source and path in client.controls:
                client.unsent[path] = None

    def deliver_values(self) -> None:
        """Send each client the newest values that others have set since the last call."""
        for client in tuple(self.clients.values()):
            unsent, client.unsent = client.unsent, {}
            entries = [self._entries[path] for path in unsent if path in self._entries]
            values = [(entry.control.path, entry.value) for entry in entries if entry.value is not None]
            if values:
                client.deliver(values, client.last_request)

    def controls_since(self, revision: int) -> list[dict[str, Any]] | None:
        """Return all controls if other things than values have changed since a revision, else None."""
        if self._structure_revision <= revision:
            return None
        return [
            {"id": entry.id, "value": entry.value, **msgspec.to_builtins(_definition(entry.control))}
            for entry in self._entries.values()
        ]

    def values_since(self, revision: int) -> list[tuple[int, Value]]:
        """Return the values that have changed since a revision, by the ids of their controls."""
        return [(entry.id, entry.value) for entry in self._entries.values() if entry.revision > revision]

    def samples_since(self, revision: int) -> list[tuple[int, NDArray[np.float64]]]:
        """Return the samples that were added since a revision, by the ids of their plots: rows of time and values."""
        plots = [(entry.id, entry.samples) for entry in self._entries.values() if entry.samples is not None]
        new = [(control_id, samples[samples[:, 0] > revision, 1:]) for control_id, samples in plots]
        return [(control_id, samples) for control_id, samples in new if len(samples)]

    def _next_structure(self) -> int:
        self.revision += 1
        self._structure_revision = self.revision
        return self.revision

    def _notify(self) -> None:
        for listener in self._listeners:
            listener()


def _definition(control: AnyControl) -> AnyControl:
    """Return a control without its value."""
    return msgspec.structs.replace(control, value=None) if hasattr(control, "value") else control


def _kind(control: AnyControl) -> tuple[object, ...]:
    """Return the type of a control, and the curves of a plot, whose samples have no meaning for other curves."""
    return type(control), getattr(control, "series", None)


def _text_chars(control: AnyControl) -> int:
    """Return the number of characters of a control's texts, which pages get."""
    texts: list[object] = [*control.path, *getattr(control, "options", ()), *getattr(control, "series", ())]
    return sum(len(str(text)) for text in texts)
