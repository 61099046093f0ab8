"""LCM's UDP multicast on the wire: short messages in one datagram, long ones in numbered fragments. No sockets here.

A short datagram is ``LC02, sequence, channel\\0, data``; a fragment is ``LC03, sequence, size of the data, offset,
number, fragments`` and then bytes of the data, in the first one behind ``channel\\0``. All words are big endian.
Source: lcm/udpm_util.h and lcm/lcm_udpm.c of LCM 1.5.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

SHORT: Final = b"LC02"
LONG: Final = b"LC03"
MOST_SHORT: Final = 65_499
"""Bytes of channel, NUL and data in one datagram (LCM_SHORT_MESSAGE_MAX_SIZE)."""
MOST_FRAGMENT: Final = 65_487
"""Bytes behind a fragment's header (LCM_FRAGMENT_MAX_PAYLOAD)."""
MOST_FRAGMENTS: Final = 65_535
LONGEST_CHANNEL: Final = 63
DATAGRAM_BYTES: Final = 65_536
"""More than a datagram can have."""
SHORT_HEAD: Final = 8
"""Bytes before the channel."""
STALE_SECONDS: Final = 5.0
"""A message whose fragments stopped coming for so long will not become whole."""
LEAST_FRAGMENT: Final = 512
"""Bytes of a fragment, on average. Real ones have 65,487, on macOS 1423; one is remembered with 300 bytes, so that
messages of more and smaller fragments would take memory that no bound counts."""
FINISHED_REMEMBERED: Final = 256
"""Messages that are remembered after they became whole, since a datagram can come twice (several routes do that)."""
MOST_UNFINISHED: Final = 1024
"""Messages on their way at a time, as many as there are senders; liblcm allows 1000."""

_LONG: Final = struct.Struct(">4sIIIHH")
_SHORT: Final = struct.Struct(">4sI")
LONG_HEAD: Final = _LONG.size
"""Bytes before a fragment's data: magic, sequence, size, offset, number, fragments."""
_FRAGMENT: Final = struct.Struct(">4xIIIHH")

Address = tuple[str, int]


class Received(NamedTuple):
    """One message. Long ones come as a view of memory that nobody else has."""

    channel: str
    data: bytes | memoryview


def datagrams(channel: str, data: bytes, sequence: int) -> Iterator[list[bytes | memoryview]]:
    """The datagrams of a message, each in pieces.

    Raises:
        ValueError: the channel is too long for LCM, or the message has more fragments than can be numbered.
    """
    name = channel.encode() + b"\0"
    if len(name) > LONGEST_CHANNEL + 1:
        raise ValueError(
            f"LCM's channel names have at most {LONGEST_CHANNEL} characters, {channel!r} has {len(name) - 1}"
        )
    if len(name) + len(data) <= MOST_SHORT:
        yield [_SHORT.pack(SHORT, sequence), name, data]
        return
    count = -(-(len(name) + len(data)) // MOST_FRAGMENT)
    if count > MOST_FRAGMENTS:
        raise ValueError(f"LCM cannot send {len(data)} bytes in one message")
    view = memoryview(data)
    offset = 0
    for number in range(count):
        head = _LONG.pack(LONG, sequence, len(data), offset, number, count)
        here = MOST_FRAGMENT - (len(name) if number == 0 else 0)
        yield [head, *([name] if number == 0 else []), view[offset : offset + here]]
        offset += here


@dataclass(slots=True, eq=False)
class _Unfinished:
    """A long message on its way."""

    data: memoryview | None
    """None: nobody wants it, its fragments are only counted."""
    size: int
    fragments: int
    touched: float
    channel: str = ""
    spans: dict[int, tuple[int, int]] = field(default_factory=dict)
    """Begin and end of each fragment that arrived; not kept of messages that nobody wants."""
    unwanted: int = 0
    """Fragments that arrived of a message that nobody wants."""
    row: int = 0
    """How many fragments came in order from the first, -1 when one did not; then nothing is read in place any more."""
    end: int = 0
    """Where the fragment after the row begins."""


class Assembler:
    """Makes messages of datagrams; those whose channel does not begin with ``prefix`` are ignored.

    The owner asks ``place`` where the next datagram should be read to, reads it, and tells ``received`` its size. In a
    row of fragments the place for a fragment's data is where it belongs, so that nothing is copied.
    """

    def __init__(
        self, prefix: bytes, most_bytes: int, most_waiting: int, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """
        Args:
            most_bytes: of one message.
            most_waiting: bytes of all messages on their way; beyond it the oldest is given up.
        """
        self._prefix = prefix
        self._most = most_bytes
        self._most_waiting = most_waiting
        self._clock = clock
        self.scratch = bytearray(DATAGRAM_BYTES)
        self._view = memoryview(self.scratch)
        self._head = self._view[:LONG_HEAD]
        self._unfinished: dict[tuple[Address, int], _Unfinished] = {}
        self._expected: memoryview | None = None
        """Where the next fragment's data belongs, if it goes on with the row of ``_expecting``."""
        self._expecting: _Unfinished | None = None
        self.waiting_bytes = 0
        """Of all messages on their way."""
        self.incomplete = 0
        """Wanted messages given up because fragments of them were lost."""
        self.refused = 0
        """Wanted messages that said they had more than ``most_bytes``, or fragments of less than ``LEAST_FRAGMENT``."""
        self._finished: dict[tuple[Address, int], tuple[int, int, float]] = {}
        """Size, fragments and time of the newest whole messages, oldest first."""

    @property
    def place(self) -> list[memoryview] | None:
        """Where the next datagram goes, in two pieces; None: into ``scratch``."""
        return None if self._expected is None else [self._head, self._expected]

    def received(self, count: int, sender: Address) -> Received | None:
        """A datagram of ``count`` bytes was read to ``place``; the message that it completes."""
        expected, owner = self._expected, self._expecting
        self._expected = self._expecting = None
        if self.scratch.startswith(LONG):
            return self._fragment(count, sender, expected, owner)
        if expected is not None:
            self._view[LONG_HEAD : max(count, LONG_HEAD)] = expected[: max(count - LONG_HEAD, 0)]
            self._expected, self._expecting = expected, owner  # the row of fragments goes on behind it
        if not self.scratch.startswith(SHORT) or not self.scratch.startswith(self._prefix, SHORT_HEAD):
            return None
        end = self.scratch.find(0, SHORT_HEAD, min(count, SHORT_HEAD + LONGEST_CHANNEL + 1))
        if end < 0:
            return None
        channel = self.scratch[SHORT_HEAD:end].decode("utf-8", "replace")
        return Received(channel, bytes(self._view[end + 1 : count]))

    def give_up_stale(self) -> None:
        """Counts the messages that will not become whole, also when none comes after them, and frees them."""
        oldest = self._clock() - STALE_SECONDS
        for key in [key for key, message in self._unfinished.items() if message.touched <= oldest]:
            self._give_up(key)

    def _fragment(
        self, count: int, sender: Address, expected: memoryview | None, owner: _Unfinished | None
    ) -> Received | None:
        if count < LONG_HEAD:
            return None
        sequence, size, offset, number, fragments = _FRAGMENT.unpack_from(self.scratch)
        key = (sender, sequence)
        message = self._unfinished.get(key)
        if message is not None and (message.size, message.fragments) != (size, fragments):
            self._give_up(key)
            message = None
        in_place = owner is not None and owner is message and (number, offset) == (owner.row, owner.end)
        if expected is not None and not in_place:
            self._view[LONG_HEAD:count] = expected[: count - LONG_HEAD]
        begin, channel = LONG_HEAD, ""
        if number == 0:
            end = self.scratch.find(0, LONG_HEAD, min(count, LONG_HEAD + LONGEST_CHANNEL + 1))
            if end < 0:
                return None
            begin, channel = end + 1, self.scratch[LONG_HEAD:end].decode("utf-8", "replace")
        until = offset + count - begin
        if number >= fragments or until > size:
            return None
        if size > self._most or fragments > size // LEAST_FRAGMENT + 2:
            self.refused += number == 0 and self.scratch.startswith(self._prefix, LONG_HEAD)
            return None
        if message is None:
            if self._has_been(key, size, fragments):
                return None
            message = self._begin(key, size, fragments)
        if number == 0:
            message.channel = channel
            if not self.scratch.startswith(self._prefix, LONG_HEAD):
                self._release(message)
        message.touched = self._clock()
        if message.data is None:
            message.unwanted += 1
            if message.unwanted >= fragments:
                del self._unfinished[key]
                self._remember(key, message)
            return None
        if number in message.spans:
            return None
        message.spans[number] = (offset, until)
        if not in_place:
            message.data[offset:until] = self._view[begin:count]
        self._expect(message, number, offset, until)
        return self._finish(key, message, message.data) if len(message.spans) == fragments else None

    def _expect(self, message: _Unfinished, number: int, offset: int, until: int) -> None:
        """The next datagram is probably the next fragment."""
        if (number, offset) != (message.row, message.end):
            message.row = -1  # what lies ahead may be there already, it must not be written over
            return
        message.row, message.end = number + 1, until
        if message.data is not None and message.row < message.fragments and message.size - until >= DATAGRAM_BYTES:
            self._expected, self._expecting = message.data[until : until + DATAGRAM_BYTES], message

    def _begin(self, key: tuple[Address, int], size: int, fragments: int) -> _Unfinished:
        now = self._clock()
        for old, other in tuple(self._unfinished.items()):
            full = len(self._unfinished) >= MOST_UNFINISHED or self.waiting_bytes + size > self._most_waiting
            if not full and now - other.touched < STALE_SECONDS:
                break
            self._give_up(old)
        # memory that is not touched costs nothing, so a lie about the size is free
        message = self._unfinished[key] = _Unfinished(np.empty(size, np.uint8).data, size, fragments, now)
        self.waiting_bytes += size
        return message

    def _finish(self, key: tuple[Address, int], message: _Unfinished, data: memoryview) -> Received | None:
        del self._unfinished[key]
        spans = sorted(message.spans.values())
        self._release(message)
        self._remember(key, message)
        at = 0
        for begin, end in spans:
            if begin != at:
                return None  # a gap would show what the memory held before
            at = end
        return Received(message.channel, data) if at == message.size else None

    def _remember(self, key: tuple[Address, int], message: _Unfinished) -> None:
        if len(self._finished) >= FINISHED_REMEMBERED:
            del self._finished[next(iter(self._finished))]
        self._finished[key] = (message.size, message.fragments, message.touched)

    def _has_been(self, key: tuple[Address, int], size: int, fragments: int) -> bool:
        """Whether a fragment belongs to a message that was whole a moment ago; another one may use its number later."""
        known = self._finished.get(key)
        if known is None:
            return False
        if known[:2] == (size, fragments) and self._clock() - known[2] < STALE_SECONDS:
            return True
        del self._finished[key]
        return False

    def _give_up(self, key: tuple[Address, int]) -> None:
        message = self._unfinished.pop(key)
        self.incomplete += message.data is not None
        self._release(message)

    def _release(self, message: _Unfinished) -> None:
        if message.data is not None:
            self.waiting_bytes -= message.size
            message.data = None
            message.unwanted = len(message.spans)
            message.spans = {}
