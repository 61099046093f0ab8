"""Delay responses that report missing paths (status 1) by a few milliseconds, for Director's Python client.

That client publishes a request and then clears its queue of commands. On a response with missing paths, another thread
of the client puts the missing commands into this queue. If the response arrives before the clearing, they are lost.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from gateway.treeviewer.client_queue import Received
from gateway.treeviewer.responses import MISSING_PATHS, AnyResponse

DELAY_SECONDS: Final = 0.01
"""Delay of a response with status 1. On a busy machine the client clears its queue within 8 ms, rarely later."""


@dataclass(frozen=True, slots=True)
class PendingResponse:
    """A response that has not been sent."""

    request: Received
    response: AnyResponse


class DelayedResponses:
    """Delayed responses by channel. The responses of a channel stay in order: later ones wait for a delayed one."""

    def __init__(self, send: Callable[[PendingResponse], None]) -> None:
        self._send = send
        self._queues: dict[str, deque[PendingResponse]] = {}

    def add(self, pending: PendingResponse) -> None:
        """Send a response, now or after the delay."""
        channel = pending.request.channel
        queue = self._queues.get(channel)
        must_wait = pending.response.status == MISSING_PATHS
        if queue is None and not must_wait:
            self._send(pending)
            return
        self._queues.setdefault(channel, deque()).append(pending)
        if must_wait:
            asyncio.get_running_loop().call_later(DELAY_SECONDS, self._delay_ended, channel)

    def flush(self) -> None:
        """Send all delayed responses now."""
        queues, self._queues = self._queues, {}
        for queue in queues.values():
            for pending in queue:
                self._send(pending)

    def _delay_ended(self, channel: str) -> None:
        """Send the oldest response, and the later ones up to the next that has a delay of its own."""
        queue = self._queues.get(channel)
        if not queue:  # flush() has sent all
            return
        self._send(queue.popleft())
        while queue and queue[0].response.status != MISSING_PATHS:
            self._send(queue.popleft())
        if not queue:
            del self._queues[channel]
