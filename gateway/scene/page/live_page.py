"""State of the browser page that clients set: background, grid, home camera, clickable paths, and controls."""

from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from typing import Any

from gateway.scene.draw.cameras import LookAtCamera
from gateway.scene.page.clicks import ClickSubscriptions
from gateway.scene.page.control_store import ControlStore


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
