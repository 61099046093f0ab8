"""Assemble messages from UDP datagrams, which may get lost, or arrive in any order or more than once."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from scenegate.lcm import udpm

STALE_SECONDS: Final = 5.0
"""An incomplete message is discarded if no fragment of it arrives for this time."""
MIN_FRAGMENT_BYTES: Final = 512
"""Minimum average size of a message's fragments. LCM's have 65,487 bytes, on macOS 1423. Each fragment takes 300 bytes
of memory besides its data, which no other limit counts."""
MAX_ENDED: Final = 256
"""Maximum number of messages that are remembered because further fragments of them are ignored."""
MAX_PARTIAL: Final = 1024
"""Maximum number of incomplete messages. liblcm's limit is 1000."""

Address = tuple[str, int]
"""IP address and port of a sender."""
MessageKey = tuple[Address, int]
"""Sender and sequence number, which identify a message."""


@dataclass(slots=True, eq=False)
class _PartialMessage:
    """An incomplete message."""

    data: memoryview
    """Memory for the message."""
    fragment_count: int
    """Number of fragments of the complete message."""
    last_arrival: float
    """Time of the last fragment, in seconds of the assembler's clock."""
    channel: str = ""
    """Channel name; empty until the first fragment arrives."""
    spans: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Begin and end of each received fragment in ``data``, by the fragment's index."""


class _EndedMessage(NamedTuple):
    """A message whose further fragments are ignored."""

    size: int
    fragment_count: int
    last_arrival: float
    """Time of the last fragment, in seconds of the assembler's clock."""


class Assembler:
    """Assembles the messages of wanted channels: those whose names start with one of ``prefixes``."""

    def __init__(
        self, prefixes: tuple[bytes, ...], max_message: int, max_bytes: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Receive channel names that start with a prefix; with a NUL at the end, it is a whole name.

        One message may have ``max_message`` bytes. Beyond ``max_bytes`` of all incomplete ones, the oldest are
        discarded.
        """
        self._prefixes = prefixes
        self._max_message = max_message
        self._max_bytes = max_bytes
        self._clock = clock
        self._partials: dict[MessageKey, _PartialMessage] = {}
        self.ended: dict[MessageKey, _EndedMessage] = {}
        """Messages whose further fragments are ignored, oldest first. They are complete, and some routes deliver each
        datagram twice; or their channel is not wanted."""
        self.waiting_bytes = 0
        """Bytes of all incomplete messages."""
        self.incomplete = 0
        """Number of wanted messages that were discarded because fragments were lost."""
        self.refused = 0
        """Number of wanted messages larger than ``max_message``, or in fragments below ``MIN_FRAGMENT_BYTES``."""

    def receive(self, datagram: bytes, sender: Address) -> udpm.UdpmMessage | None:
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

    def _add(self, fragment: udpm.Fragment, key: MessageKey) -> udpm.UdpmMessage | None:
        """Add a fragment; return the message that it completes, or None."""
        size, count = fragment.message_size, fragment.fragment_count
        partial = self._partials.get(key)
        if partial is not None and (len(partial.data), partial.fragment_count) != (size, count):
            self._discard(key)
            partial = None
        wanted = fragment.channel is None or (fragment.channel + b"\0").startswith(self._prefixes)
        if size > self._max_message or count > size // MIN_FRAGMENT_BYTES + 2:
            self.refused += fragment.channel is not None and wanted
            return None
        if self._has_ended(key, size, count):
            return None
        if not wanted:
            self._end(key, size, count)
            return None
        partial = partial or self._add_partial(key, size, count)
        if fragment.channel is not None:
            partial.channel = fragment.channel.decode("utf-8", "replace")
        partial.last_arrival = self._clock()
        if fragment.fragment_index in partial.spans:
            return None
        end = fragment.offset + len(fragment.payload)
        partial.spans[fragment.fragment_index] = (fragment.offset, end)
        partial.data[fragment.offset : end] = fragment.payload
        if len(partial.spans) < count:
            return None
        self._end(key, size, count)
        position = 0
        for begin, end in sorted(partial.spans.values()):
            if begin != position:
                return None  # a gap, which is uninitialised memory
            position = end
        return udpm.UdpmMessage(partial.channel, partial.data) if position == size else None

    def _add_partial(self, key: MessageKey, size: int, count: int) -> _PartialMessage:
        """Return a new incomplete message; discard stale ones, and the oldest ones if they exceed a limit."""
        now = self._clock()
        for oldest_key, oldest in tuple(self._partials.items()):
            is_full = len(self._partials) >= MAX_PARTIAL or self.waiting_bytes + size > self._max_bytes
            if not is_full and now - oldest.last_arrival < STALE_SECONDS:
                break
            self._discard(oldest_key)
        # the kernel allocates pages when they are written, so a false size costs no memory
        partial = self._partials[key] = _PartialMessage(np.empty(size, np.uint8).data, count, now)
        self.waiting_bytes += size
        return partial

    def _end(self, key: MessageKey, size: int, count: int) -> None:
        """Forget a message, if it has begun, and ignore further fragments of it."""
        partial = self._partials.pop(key, None)
        if partial is not None:
            self.waiting_bytes -= len(partial.data)
        if len(self.ended) >= MAX_ENDED:
            del self.ended[next(iter(self.ended))]
        self.ended[key] = _EndedMessage(size, count, self._clock())

    def _has_ended(self, key: MessageKey, size: int, count: int) -> bool:
        """Return True if a fragment belongs to a message in ``ended``, of which one arrived in ``STALE_SECONDS``."""
        ended = self.ended.pop(key, None)
        now = self._clock()
        if ended is None or (ended.size, ended.fragment_count) != (size, count):
            return False
        if now - ended.last_arrival >= STALE_SECONDS:
            return False
        self.ended[key] = ended._replace(last_arrival=now)
        return True

    def _discard(self, key: MessageKey) -> None:
        """Discard an incomplete message, and count it."""
        partial = self._partials.pop(key)
        self.waiting_bytes -= len(partial.data)
        self.incomplete += 1
