"""Settings of the page that shows the live tree, by clients: background, grid, home camera, and clickable paths."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from gateway.scene.cameras import LookAtCamera
from gateway.scene.clicks import ClickSubscriptions


@dataclass(frozen=True, slots=True)
class PageView:
    """View settings of the page. None: as the page has it by itself."""

    background: tuple[float, float, float] | None = None
    """Red, green, blue: sRGB from 0 to 1."""
    grid: bool | None = None
    """False hides the grid on the ground."""
    home: LookAtCamera | None = None
    """Camera of the home view, without ``fovy``."""


class LivePage:
    """View settings and clickable paths of all pages. Not thread-safe: it is used in the event loop's thread only.

    It is not part of ``--state``: clients set it again when the gateway starts.
    """

    def __init__(self) -> None:
        self.view = PageView()
        self.clicks = ClickSubscriptions()
        self._listeners: list[Callable[[], None]] = []

    def change_view(self, changes: dict[str, Any]) -> None:
        """Replace fields of ``view``."""
        self.view = replace(self.view, **changes)
        self.notify()

    def notify(self) -> None:
        """Call the listeners, after a change of ``view`` or of ``clicks``."""
        for listener in self._listeners:
            listener()

    def listen(self, listener: Callable[[], None]) -> None:
        """Call ``listener`` after every change. It must not block."""
        self._listeners.append(listener)
