"""Assemble messages from UDP datagrams, which may get lost, or arrive in any order or more than once."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from scenegate.lcm import udpm

STALE_SECONDS: Final = 5.0
"""An incomplete message is discarded if no fragment of it arrives for this time."""
MIN_FRAGMENT_BYTES: Final = 512
"""Minimum average size of a message's fragments. LCM's have 65,487 bytes, on macOS 1423. Each fragment takes 300 bytes
of memory besides its data, which no other limit counts."""
MAX_COMPLETED: Final = 256
"""Maximum number of completed messages that are remembered, to ignore repeated datagrams. Some routes deliver each
datagram twice."""
MAX_PARTIAL: Final = 1024
"""Maximum number of incomplete messages. liblcm's limit is 1000."""

Address = tuple[str, int]
"""IP address and port of a sender."""
MessageKey = tuple[Address, int]
"""Sender and sequence number, which identify a message."""


@dataclass(slots=True, eq=False)
class _PartialMessage:
    """An incomplete message."""

    data: memoryview | None
    """Memory for the message; None: the channel is not wanted, so fragments are only counted."""
    size: int
    """Bytes of the complete message."""
    fragment_count: int
    """Number of fragments of the complete message."""
    last_arrival: float
    """Time of the last fragment, in seconds of the assembler's clock."""
    channel: str = ""
    """Channel name; empty until the first fragment arrives."""
    spans: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Begin and end of each received fragment in ``data``, by the fragment's index."""
    ignored_fragments: int = 0
    """Number of received fragments, if the channel is not wanted."""


class Assembler:
    """Assembles the messages of wanted channels: those whose names start with one of ``prefixes``."""

    def __init__(
        self, prefixes: tuple[bytes, ...], max_message: int, max_bytes: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Create an assembler without messages.

        Args:
            prefixes: starts of the channel names to receive; with a NUL at the end, whole names.
            max_message: maximum bytes of one message.
            max_bytes: maximum bytes of all incomplete messages. Beyond it, the oldest ones are discarded.
            clock: monotonic time in seconds.
        """
        self._prefixes = prefixes
        self._max_message = max_message
        self._max_bytes = max_bytes
        self._clock = clock
        self._partials: dict[MessageKey, _PartialMessage] = {}
        self.completed: dict[MessageKey, tuple[int, int, float]] = {}
        """Size, number of fragments and time of the last fragment of completed messages, oldest first."""
        self.waiting_bytes = 0
        """Bytes of all incomplete messages."""
        self.incomplete = 0
        """Number of wanted messages that were discarded because fragments were lost."""
        self.refused = 0
        """Number of wanted messages larger than ``max_message``, or in fragments below ``MIN_FRAGMENT_BYTES``."""

    def receive(self, datagram: bytes, sender: Address) -> udpm.Message | None:
        """Add a datagram; return the message that it completes, or None."""
        if datagram.startswith(udpm.SHORT_MAGIC):
            return udpm.parse_short(datagram, self._prefixes)
        fragment = udpm.parse_fragment(datagram) if datagram.startswith(udpm.LONG_MAGIC) else None
        return None if fragment is None else self._add(fragment, (sender, fragment.sequence))

    def discard_stale(self) -> None:
        """Discard messages of which no fragment has arrived for ``STALE_SECONDS``."""
        stale_since = self._clock() - STALE_SECONDS
        for key in [key for key, partial in self._partials.items() if partial.last_arrival <= stale_since]:
            self._discard(key)

    def _add(self, fragment: udpm.Fragment, key: MessageKey) -> udpm.Message | None:
        """Add a fragment; return the message that it completes, or None."""
        size, count = fragment.message_size, fragment.fragment_count
        partial = self._partials.get(key)
        if partial is not None and (partial.size, partial.fragment_count) != (size, count):
            self._discard(key)
            partial = None
        wanted = fragment.channel is None or (fragment.channel + b"\0").startswith(self._prefixes)
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
        partial.last_arrival = self._clock()
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

    def _add_partial(self, key: MessageKey, size: int, count: int) -> _PartialMessage:
        """Return a new incomplete message; discard stale ones, and the oldest ones if they exceed a limit."""
        now = self._clock()
        for oldest_key, oldest in tuple(self._partials.items()):
            full = len(self._partials) >= MAX_PARTIAL or self.waiting_bytes + size > self._max_bytes
            if not full and now - oldest.last_arrival < STALE_SECONDS:
                break
            self._discard(oldest_key)
        # the kernel allocates pages when they are written, so a false size costs no memory
        partial = self._partials[key] = _PartialMessage(np.empty(size, np.uint8).data, size, count, now)
        self.waiting_bytes += size
        return partial

    def _complete(self, key: MessageKey, partial: _PartialMessage, data: memoryview) -> udpm.Message | None:
        """Return the message. Returns None if its fragments leave gaps, because these are uninitialised memory."""
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

    def _add_completed(self, key: MessageKey, partial: _PartialMessage) -> None:
        """Remember a completed message, to ignore repetitions of its fragments."""
        if len(self.completed) >= MAX_COMPLETED:
            del self.completed[next(iter(self.completed))]
        self.completed[key] = (partial.size, partial.fragment_count, partial.last_arrival)

    def _is_repeated(self, key: MessageKey, size: int, count: int) -> bool:
        """Return True if a fragment belongs to a message that was completed less than ``STALE_SECONDS`` ago."""
        completed = self.completed.get(key)
        if completed is None:
            return False
        completed_size, completed_count, completed_at = completed
        if (completed_size, completed_count) == (size, count) and self._clock() - completed_at < STALE_SECONDS:
            return True
        del self.completed[key]
        return False

    def _discard(self, key: MessageKey) -> None:
        """Discard an incomplete message, and count it if it is wanted."""
        partial = self._partials.pop(key)
        self.incomplete += partial.data is not None
        self._release(partial)

    def _release(self, partial: _PartialMessage) -> None:
        """Free the memory of a message. Its further fragments are only counted."""
        if partial.data is not None:
            self.waiting_bytes -= partial.size
            partial.data = None
            partial.ignored_fragments = len(partial.spans)
            partial.spans = {}
