"""Delay responses that report missing paths (status 1) by a few milliseconds, for Director's Python client.

That client publishes a request and then clears its queue of commands. On a response with missing paths, another thread
of the client puts the missing commands into this queue. If the response arrives before the clearing, they are lost.
"""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

DELAY_SECONDS: Final = 0.01
"""Delay of a response with status 1. On a busy machine the client clears its queue within 8 ms, rarely later."""


class _Waiting(NamedTuple):
    send: Callable[[], None]
    has_missing_paths: bool
    """False: it waits only for those before it."""


class DelayedResponses:
    """Responses with missing paths, and those behind them: the responses of a channel stay in order."""

    def __init__(self) -> None:
        self.queues: dict[str, deque[_Waiting]] = {}
        """Responses that wait, by channel of the request. A channel without such responses has no queue."""

    def add(self, channel: str, send: Callable[[], None], *, has_missing_paths: bool) -> None:
        """Call ``send`` later: after the delay if the response has missing paths, else after those before it."""
        self.queues.setdefault(channel, deque()).append(_Waiting(send, has_missing_paths))
        if has_missing_paths:
            asyncio.get_running_loop().call_later(DELAY_SECONDS, self._delay_ended, channel)

    def flush(self) -> None:
        """Send all responses now."""
        queues, self.queues = self.queues, {}
        for queue in queues.values():
            for waiting in queue:
                waiting.send()

    def _delay_ended(self, channel: str) -> None:
        """Send the oldest response, and the later ones up to the next that has a delay of its own."""
        queue = self.queues.get(channel)
        if not queue:  # flush() has sent all
            return
        queue.popleft().send()
        while queue and not queue[0].has_missing_paths:
            queue.popleft().send()
        if not queue:
            del self.queues[channel]
