"""State of the browser page that clients set: background, grid, home camera, clickable paths, and controls.

A client names all paths whose clicks it wants and repeats that before ``lease_seconds`` are over. A client that has
vanished is forgotten afterwards; over UDP there is no other sign of it.
"""

import time
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from gateway.scene.draw.cameras import LookAtCamera
from gateway.scene.page.control_store import ControlStore
from gateway.scene.tree.nodes import Path
from scenegate.messages.clicks import Click


@dataclass(frozen=True, slots=True)
class ClickLimits:
    """Limits of subscriptions to clicks. A subscription beyond a limit fails."""

    clients: int = 64
    """Maximum number of clients with a subscription: each click is compared with the paths of all."""
    paths: int = 1000
    """Maximum number of paths of one client: every page gets all of them."""
    path_chars: int = 100_000
    """Maximum number of characters in the paths of one client, for the same reason."""
    lease_seconds: float = 30.0
    """Time after which a client that has not repeated its subscription is forgotten."""


@dataclass(frozen=True, slots=True)
class _Subscription:
    paths: tuple[Path, ...]
    deliver: Callable[[Click], None]
    end: float
    """Time of the clock at which the lease ends."""


class ClickSubscriptions:
    """Paths whose clicks clients want. Not thread-safe: it is used in the event loop's thread only."""

    def __init__(self, limits: ClickLimits | None = None, clock: Callable[[], float] = time.monotonic) -> None:
        self.limits = limits or ClickLimits()
        self._clock = clock
        self.subscriptions: dict[Hashable, _Subscription] = {}
        """Subscriptions by client."""

    def subscribe(self, client: Hashable, paths: Sequence[Path], deliver: Callable[[Click], None]) -> str:
        """Replace the paths of a client, which gets clicks on geometry at and below them; none: it is forgotten.

        ``deliver`` is called with each click, and must not block. Returns the reason of a refusal, which changes
        nothing, or "".
        """
        if len(paths) > self.limits.paths:
            return f"{len(paths)} paths are clickable, the limit for one client is {self.limits.paths}"
        chars = sum(len(str(element)) for path in paths for element in path)
        if chars > self.limits.path_chars:
            return f"the clickable paths have {chars} characters, the limit for one client is {self.limits.path_chars}"
        if not paths:
            self.subscriptions.pop(client, None)
            return ""
        self._forget_vanished()
        if client not in self.subscriptions and len(self.subscriptions) >= self.limits.clients:
            return f"{len(self.subscriptions)} clients wait for clicks, which is the limit"
        end = self._clock() + self.limits.lease_seconds
        self.subscriptions[client] = _Subscription(tuple(dict.fromkeys(paths)), deliver, end)
        return ""

    def paths(self) -> tuple[Path, ...]:
        """Return the paths of all clients, without duplicates."""
        self._forget_vanished()
        return tuple(dict.fromkeys(path for entry in self.subscriptions.values() for path in entry.paths))

    def click(self, click: Click) -> None:
        """Deliver a click to each client that wants it, once."""
        self._forget_vanished()
        for entry in tuple(self.subscriptions.values()):
            if any(click.path[: len(path)] == path for path in entry.paths):
                entry.deliver(click)

    def forget(self, is_gone: Callable[[Hashable], bool]) -> bool:
        """Remove the subscriptions of clients that have disconnected; return True if there were any."""
        gone = [client for client in self.subscriptions if is_gone(client)]
        for client in gone:
            del self.subscriptions[client]
        return bool(gone)

    def _forget_vanished(self) -> None:
        now = self._clock()
        self.forget(lambda client: self.subscriptions[client].end < now)


@dataclass(frozen=True, slots=True)
class PageView:
    """View settings of the page. None: the page's own default."""

    background: tuple[float, float, float] | None = None
    """Red, green, blue: sRGB from 0 to 1."""
    grid: bool | None = None
    """False hides the grid on the ground."""
    home: LookAtCamera | None = None
    """Camera of the home view. Its ``fovy`` is not used."""


class LivePage:
    """View settings, clickable paths and controls, which all open pages share.

    Not thread-safe: used on the event loop only. It is not part of ``--state``: clients set it again when the gateway
    has started.
    """

    def __init__(self) -> None:
        self.view = PageView()
        self.clicks = ClickSubscriptions()
        self.controls = ControlStore()
        self._listeners: list[Callable[[], None]] = []

    def change_view(self, changes: dict[str, Any]) -> None:
        """Replace fields of ``view``, by name, and call the listeners."""
        self.view = replace(self.view, **changes)
        self.notify()

    def forget(self, is_gone: Callable[[Hashable], bool]) -> None:
        """Remove clickable paths and controls of clients that have disconnected."""
        self.controls.forget(is_gone)
        if self.clicks.forget(is_gone):
            self.notify()

    def notify(self) -> None:
        """Call the listeners. Callers of methods of ``clicks`` call this after a change."""
        for listener in self._listeners:
            listener()

    def listen(self, listener: Callable[[], None]) -> None:
        """Register a listener for changes of the view and of clickable paths, not of controls. It must not block."""
        self._listeners.append(listener)
