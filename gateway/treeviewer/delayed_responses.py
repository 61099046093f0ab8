"""Hold back responses with status 1, and those behind them, for a few milliseconds.

Director's Python client clears its queue of commands right after it has published a request. A response that reports
missing paths makes it queue the missing commands; when that happens before the clearing, they are lost.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gateway.treeviewer.client_queue import Publish
from gateway.treeviewer.responses import MISSING_PATHS, AnyResponse

DELAY_SECONDS: Final = 0.01
"""Delay of a response with status 1. On a busy machine the client takes up to 8 ms, rarely more."""


@dataclass(frozen=True, slots=True)
class PendingResponse:
    """A response and its destination."""

    channel: str
    """Channel of the request."""
    response: AnyResponse
    publish: Publish
    binary: bool
    """True: in MessagePack."""


class DelayedResponses:
    """Queues of delayed responses by channel. The order of a channel's responses is kept."""

    def __init__(self, send: Callable[[PendingResponse], None]) -> None:
        self._send = send
        self._queues: dict[str, deque[PendingResponse]] = {}

    def add(self, pending: PendingResponse) -> None:
        """Send a response now, or after the delay."""
        queue = self._queues.get(pending.channel)
        missing = pending.response.status == MISSING_PATHS
        if queue is None and not missing:
            self._send(pending)
            return
        self._queues.setdefault(pending.channel, deque()).append(pending)
        if missing:
            asyncio.get_running_loop().call_later(DELAY_SECONDS, self._delay_ended, pending.channel)

    def flush(self) -> None:
        """Send all delayed responses now."""
        queues, self._queues = self._queues, {}
        for queue in queues.values():
            for pending in queue:
                self._send(pending)

    def _delay_ended(self, channel: str) -> None:
        """Send the oldest response and those behind it, up to the next with status 1."""
        queue = self._queues.get(channel)
        if not queue:  # flushed
            return
        self._send(queue.popleft())
        while queue and queue[0].response.status != MISSING_PATHS:
            self._send(queue.popleft())
        if not queue:
            del self._queues[channel]
