"""Put messages together from UDP datagrams that arrive in any order, incomplete or more than once."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gateway.lcm import udpm

STALE_SECONDS: Final = 5.0
"""A message that got no fragment for this time is discarded."""
MIN_FRAGMENT_BYTES: Final = 512
"""Minimum average size of a message's fragments. Real ones have 65,487 bytes, 1423 on macOS. Each fragment costs 300
bytes of bookkeeping, which no other limit counts."""
MAX_COMPLETED: Final = 256
"""Completed messages remembered to recognise repeated datagrams; some routes deliver each datagram twice."""
MAX_PARTIAL: Final = 1024
"""Maximum number of incomplete messages; liblcm has 1000."""

Address = tuple[str, int]


@dataclass(slots=True, eq=False)
class _Partial:
    """A long message with some of its fragments."""

    data: memoryview | None
    """None: the channel is not wanted, so fragments are only counted."""
    size: int
    fragments: int
    updated: float
    channel: str = ""
    spans: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Begin and end of each received fragment in ``data``, by index."""
    ignored: int = 0
    """Number of received fragments of an unwanted message."""


class Assembler:
    """Turns datagrams into messages. Channels that do not start with ``prefix`` are ignored."""

    def __init__(
        self, prefix: bytes, max_message: int, max_bytes: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """
        Args:
            max_message: maximum bytes of one message.
            max_bytes: maximum bytes of all incomplete messages; beyond it the oldest is discarded.
        """
        self._prefix = prefix
        self._max_message = max_message
        self._max_bytes = max_bytes
        self._clock = clock
        self._partials: dict[tuple[Address, int], _Partial] = {}
        self.completed: dict[tuple[Address, int], tuple[int, int, float]] = {}
        """Size, number of fragments and time of the last completed messages, oldest first."""
        self.waiting_bytes = 0
        """Bytes of all incomplete messages."""
        self.incomplete = 0
        """Wanted messages discarded because fragments were lost."""
        self.refused = 0
        """Wanted messages larger than ``max_message``, or in fragments smaller than ``MIN_FRAGMENT_BYTES``."""

    def receive(self, datagram: bytes, sender: Address) -> udpm.Message | None:
        """Take a datagram and return the message that it completes, if any."""
        if datagram.startswith(udpm.SHORT):
            return udpm.parse_short(datagram, self._prefix)
        fragment = udpm.parse_fragment(datagram) if datagram.startswith(udpm.LONG) else None
        return None if fragment is None else self._add(fragment, (sender, fragment.sequence))

    def discard_stale(self) -> None:
        """Discard and count the messages whose fragments stopped arriving."""
        limit = self._clock() - STALE_SECONDS
        for key in [key for key, partial in self._partials.items() if partial.updated <= limit]:
            self._discard(key)

    def _add(self, fragment: udpm.Fragment, key: tuple[Address, int]) -> udpm.Message | None:
        size, count = fragment.size, fragment.fragments
        partial = self._partials.get(key)
        if partial is not None and (partial.size, partial.fragments) != (size, count):
            self._discard(key)
            partial = None
        wanted = fragment.channel is None or fragment.channel.startswith(self._prefix)
        if size > self._max_message or count > size // MIN_FRAGMENT_BYTES + 2:
            self.refused += fragment.channel is not None and wanted
            return None
        if partial is None:
            if self._is_repeated(key, size, count):
                return None
            partial = self._begin(key, size, count)
        if fragment.channel is not None:
            partial.channel = fragment.channel.decode("utf-8", "replace")
            if not wanted:
                self._release(partial)
        partial.updated = self._clock()
        if partial.data is None:
            partial.ignored += 1
            if partial.ignored >= count:
                del self._partials[key]
                self._remember(key, partial)
            return None
        if fragment.number in partial.spans:
            return None
        end = fragment.offset + len(fragment.payload)
        partial.spans[fragment.number] = (fragment.offset, end)
        partial.data[fragment.offset : end] = fragment.payload
        return self._complete(key, partial, partial.data) if len(partial.spans) == count else None

    def _begin(self, key: tuple[Address, int], size: int, count: int) -> _Partial:
        now = self._clock()
        for oldest, other in tuple(self._partials.items()):
            full = len(self._partials) >= MAX_PARTIAL or self.waiting_bytes + size > self._max_bytes
            if not full and now - other.updated < STALE_SECONDS:
                break
            self._discard(oldest)
        # the kernel backs these pages only when they are written, so a false size costs nothing
        partial = self._partials[key] = _Partial(np.empty(size, np.uint8).data, size, count, now)
        self.waiting_bytes += size
        return partial

    def _complete(self, key: tuple[Address, int], partial: _Partial, data: memoryview) -> udpm.Message | None:
        """Return the message, or None if its fragments leave gaps, which would expose uninitialised memory."""
        del self._partials[key]
        spans = sorted(partial.spans.values())
        self._release(partial)
        self._remember(key, partial)
        position = 0
        for begin, end in spans:
            if begin != position:
                return None
            position = end
        return udpm.Message(partial.channel, data) if position == partial.size else None

    def _remember(self, key: tuple[Address, int], partial: _Partial) -> None:
        if len(self.completed) >= MAX_COMPLETED:
            del self.completed[next(iter(self.completed))]
        self.completed[key] = (partial.size, partial.fragments, partial.updated)

    def _is_repeated(self, key: tuple[Address, int], size: int, count: int) -> bool:
        """Return whether a fragment belongs to a message completed less than ``STALE_SECONDS`` ago."""
        known = self.completed.get(key)
        if known is None:
            return False
        if known[:2] == (size, count) and self._clock() - known[2] < STALE_SECONDS:
            return True
        del self.completed[key]
        return False

    def _discard(self, key: tuple[Address, int]) -> None:
        partial = self._partials.pop(key)
        self.incomplete += partial.data is not None
        self._release(partial)

    def _release(self, partial: _Partial) -> None:
        """Free the message's memory and only count its fragments from now on."""
        if partial.data is not None:
            self.waiting_bytes -= partial.size
            partial.data = None
            partial.ignored = len(partial.spans)
            partial.spans = {}
