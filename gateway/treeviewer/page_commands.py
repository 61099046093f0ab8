"""Execute the commands of a request that concern the page instead of the tree: its view, clicks and controls."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass

from gateway.scene.live_page import LivePage
from gateway.scene.tree import Path
from gateway.treeviewer.requests import Finding, Request
from gateway.treeviewer.responses import ClickMessage, ControlsMessage, ControlValue, PageMessage
from scenegate.messages.controls import Value


@dataclass(frozen=True, slots=True)
class PageClient:
    """The client that sent a request, as a receiver of clicks and values from the page."""

    key: Hashable | None
    """Identifies the client; None without a client id, because clients without an id share a channel."""
    send: Callable[[PageMessage], None]

    def send_values(self, values: Sequence[tuple[Path, Value]], after: int) -> None:
        """Send values of controls. See ``gateway.scene.controls.Deliver``."""
        self.send(ControlsMessage([ControlValue(path, value) for path, value in values], after))


def update_page(page: LivePage, request: Request, client: PageClient | None, utime: int) -> None:
    """Execute the commands for the page; add a failure to the request for each that cannot be executed.

    Args:
        page: state that all browser pages share.
        request: a request; the caller has executed its commands for the tree.
        client: the sender; None if it cannot receive messages of the page.
        utime: time of the request.
    """
    if request.view is not None:
        page.change_view(request.view)
    if request.click_paths is None and request.controls is None and not request.control_changes:
        return
    if client is None or client.key is None:
        for name in sorted({"setclicks", "setcontrols", "setvalues"} & set(request.newer_commands)):
            reason = "clicks and values are sent only on a channel with a client id"
            request.failures.append(Finding(name, 0, reason))
        return
    if request.click_paths is not None:
        reason = page.clicks.subscribe(client.key, request.click_paths, lambda click: client.send(ClickMessage(click)))
        if reason:
            request.failures.append(Finding("setclicks", 0, reason))
        else:
            page.notify()
    _update_controls(page, request, client, utime)


def _update_controls(page: LivePage, request: Request, client: PageClient, utime: int) -> None:
    """Execute ``setcontrols`` and ``setvalues``."""
    store = page.controls
    if request.controls is not None:
        reason = store.set_controls(client.key, request.controls, client.send_values, utime)
        if reason:
            request.failures.append(Finding("setcontrols", 0, reason))
    for change in request.control_changes:
        try:
            if change.samples is not None:
                store.add_samples(client.key, change.path, change.samples, utime)
            else:
                store.set_value(client.key, change.path, change.value, utime)
        except ValueError as error:
            request.failures.append(Finding("setvalues", change.index, str(error), change.path))
