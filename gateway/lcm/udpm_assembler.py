"""Reassemble messages from UDP datagrams that arrive in any order, incomplete or more than once."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from gateway.lcm import udpm

STALE_SECONDS: Final = 5.0
"""A message is discarded if no fragment of it arrives for this time."""
MIN_FRAGMENT_BYTES: Final = 512
"""Minimum average size of a message's fragments. Real ones have 65,487 bytes, 1423 on macOS. Each fragment costs 300
bytes of bookkeeping, which no other limit counts."""
MAX_COMPLETED: Final = 256
"""Number of completed messages kept to recognise repeated datagrams; some routes deliver each datagram twice."""
MAX_PARTIAL: Final = 1024
"""Maximum number of incomplete messages; liblcm has 1000."""

Address = tuple[str, int]


@dataclass(slots=True, eq=False)
class _PartialMessage:
    """A long message with some of its fragments."""

    data: memoryview | None
    """None: the channel is not wanted, so fragments are only counted."""
    size: int
    fragment_count: int
    updated: float
    """Seconds of the assembler's clock at which the last fragment arrived."""
    channel: str = ""
    spans: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Begin and end of each received fragment in ``data``, by index."""
    ignored_fragments: int = 0
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
        self._partials: dict[tuple[Address, int], _PartialMessage] = {}
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
        if datagram.startswith(udpm.SHORT_MAGIC):
            return udpm.parse_short(datagram, self._prefix)
        fragment = udpm.parse_fragment(datagram) if datagram.startswith(udpm.LONG_MAGIC) else None
        return None if fragment is None else self._add(fragment, (sender, fragment.sequence))

    def discard_stale(self) -> None:
        """Discard and count the messages whose fragments stopped arriving."""
        limit = self._clock() - STALE_SECONDS
        for key in [key for key, partial in self._partials.items() if partial.updated <= limit]:
            self._discard(key)

    def _add(self, fragment: udpm.Fragment, key: tuple[Address, int]) -> udpm.Message | None:
        size, count = fragment.message_size, fragment.fragment_count
        partial = self._partials.get(key)
        if partial is not None and (partial.size, partial.fragment_count) != (size, count):
            self._discard(key)
            partial = None
        wanted = fragment.channel is None or fragment.channel.startswith(self._prefix)
        if size > self._max_message or count > size // MIN_FRAGMENT_BYTES + 2:
            self.refused += fragment.channel is not None and wanted
            return None
        if partial is None:
            if self._is_repeated(key, size, count):
                return None
            partial = self._add_partial(key, size, count)
        if fragment.channel is not None:
            partial.channel = fragment.channel.decode("utf-8", "replace")
            if not wanted:
                self._release(partial)
        partial.updated = self._clock()
        if partial.data is None:
            partial.ignored_fragments += 1
            if partial.ignored_fragments >= count:
                del self._partials[key]
                self._add_completed(key, partial)
            return None
        if fragment.fragment_index in partial.spans:
            return None
        end = fragment.offset + len(fragment.payload)
        partial.spans[fragment.fragment_index] = (fragment.offset, end)
        partial.data[fragment.offset : end] = fragment.payload
        return self._complete(key, partial, partial.data) if len(partial.spans) == count else None

    def _add_partial(self, key: tuple[Address, int], size: int, count: int) -> _PartialMessage:
        now = self._clock()
        for oldest_key, oldest in tuple(self._partials.items()):
            full = len(self._partials) >= MAX_PARTIAL or self.waiting_bytes + size > self._max_bytes
            if not full and now - oldest.updated < STALE_SECONDS:
                break
            self._discard(oldest_key)
        # the kernel backs these pages only when they are written, so a false size costs nothing
        partial = self._partials[key] = _PartialMessage(np.empty(size, np.uint8).data, size, count, now)
        self.waiting_bytes += size
        return partial

    def _complete(self, key: tuple[Address, int], partial: _PartialMessage, data: memoryview) -> udpm.Message | None:
        """Return the message, or None if its fragments leave gaps, which would expose uninitialised memory."""
        del self._partials[key]
        spans = sorted(partial.spans.values())
        self._release(partial)
        self._add_completed(key, partial)
        position = 0
        for begin, end in spans:
            if begin != position:
                return None
            position = end
        return udpm.Message(partial.channel, data) if position == partial.size else None

    def _add_completed(self, key: tuple[Address, int], partial: _PartialMessage) -> None:
        if len(self.completed) >= MAX_COMPLETED:
            del self.completed[next(iter(self.completed))]
        self.completed[key] = (partial.size, partial.fragment_count, partial.updated)

    def _is_repeated(self, key: tuple[Address, int], size: int, count: int) -> bool:
        """Return whether a fragment belongs to a message completed less than ``STALE_SECONDS`` ago."""
        completed = self.completed.get(key)
        if completed is None:
            return False
        completed_size, completed_count, completed_at = completed
        if (completed_size, completed_count) == (size, count) and self._clock() - completed_at < STALE_SECONDS:
            return True
        del self.completed[key]
        return False

    def _discard(self, key: tuple[Address, int]) -> None:
        partial = self._partials.pop(key)
        self.incomplete += partial.data is not None
        self._release(partial)

    def _release(self, partial: _PartialMessage) -> None:
        """Free the message's memory; its further fragments are only counted."""
        if partial.data is not None:
            self.waiting_bytes -= partial.size
            partial.data = None
            partial.ignored_fragments = len(partial.spans)
            partial.spans = {}
