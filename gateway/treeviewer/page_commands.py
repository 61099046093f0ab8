"""Execute the commands of a request that concern the page instead of the tree: ``setview`` and ``setclicks``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from gateway.scene.clicks import Click
from gateway.scene.live_page import LivePage
from gateway.treeviewer.requests import Finding, Request


@dataclass(frozen=True, slots=True)
class ClickReceiver:
    """The client that sent a request, as a receiver of clicks."""

    channel: str
    """Channel of its requests; empty without a client id, because clients without an id share a channel."""
    deliver: Callable[[Click], None]
    """Sends a click to the client."""


def update_page(page: LivePage, request: Request, receiver: ClickReceiver | None) -> None:
    """Execute the commands for the page; add a failure to the request if one cannot be executed.

    Args:
        page: state that all browser pages share.
        request: a request; the caller has executed its commands for the tree.
        receiver: the client; None if it cannot receive clicks.
    """
    if request.view is not None:
        page.change_view(request.view)
    paths = request.click_paths
    if paths is None:
        return
    if receiver is None or not receiver.channel:
        reason = "clicks are sent only on a channel with a client id"
    else:
        reason = page.clicks.subscribe(receiver.channel, paths, receiver.deliver)
    if reason:
        request.failures.append(Finding("setclicks", 0, None, reason))
    else:
        page.notify()
