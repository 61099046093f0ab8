"""LCM's TCPQ on the wire: big-endian words, then frames ``type, length, channel [, length, data]`` in both directions.

The client speaks first (its magic and version), the hub answers with its own; then the client subscribes with patterns
and publishes, the hub sends what matches. Sources of the numbers: lcm/lcm_tcpq.c and TCPProvider.java of LCM 1.5.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import IntEnum
from typing import Final

import numpy as np

MAGIC_HUB: Final = 0x287617FA
MAGIC_CLIENT: Final = 0x287617FB
VERSION: Final = 0x0100
HUB_HELLO: Final = struct.pack(">II", MAGIC_HUB, VERSION)
CLIENT_HELLO: Final = struct.pack(">II", MAGIC_CLIENT, VERSION)
LONGEST_CHANNEL: Final = 999
"""Bytes of a relayed message's channel name. TCPQ has no limit, but LCM's programs cannot read a log of longer ones."""
LONGEST_PATTERN: Final = 2 * LONGEST_CHANNEL
"""Bytes of a subscription: enough for a channel of which every character is escaped."""
LONGEST_NAME: Final = 64 * 1024
"""Bytes of a channel name or subscription that a peer may send at all; more than that is not TCPQ but garbage."""
MOST_AT_ONCE: Final = 512 * 1024
"""Bytes read at a time into a big message: copying them takes 0.2 ms, then other connections have their turn."""
SCRATCH_BYTES: Final = 256 * 1024
"""What one read can bring; bigger payloads are read straight into place."""

_WORD: Final = struct.Struct(">I")
_WORDS: Final = struct.Struct(">II")


class Frame(IntEnum):
    PUBLISH = 1
    SUBSCRIBE = 2
    UNSUBSCRIBE = 3


class FrameError(ValueError):
    """The peer does not speak TCPQ, or more than is allowed; the message says what."""


def publish_head(channel: str, size: int) -> bytes:
    """Everything of a published message that stands before its ``size`` bytes of data."""
    name = channel.encode()
    return b"".join((_WORDS.pack(Frame.PUBLISH, len(name)), name, _WORD.pack(size)))


def subscription(kind: Frame, pattern: str) -> bytes:
    """A SUBSCRIBE or UNSUBSCRIBE frame."""
    name = pattern.encode()
    return _WORDS.pack(kind, len(name)) + name


class FrameReader:
    """Cuts a byte stream into frames, without copying big payloads.

    Ask ``buffer`` where to put the next bytes, then tell ``received`` how many there are.
    """

    def __init__(
        self,
        hello: int,
        most: int,
        on_frame: Callable[[Frame, str, memoryview | bytes], None],
        reserve: Callable[[int], bool],
    ) -> None:
        """
        Args:
            hello: the magic that the peer must begin with.
            most: bytes of one message.
            on_frame: kind, channel or pattern, data; big messages come as a view of memory that nobody else has.
            reserve: asked before a big message is collected, with its size; told with minus that when it is complete.
        """
        self._hello = hello
        self._most = most
        self._on_frame = on_frame
        self._reserve = reserve
        self.reserved = 0
        """Bytes of the big message that is on its way."""
        self._scratch = bytearray(SCRATCH_BYTES)
        self._view = memoryview(self._scratch)
        self._begin = 0
        self._end = 0
        self._greeted = False
        self._channel = ""
        self._big: memoryview | None = None
        self._filled = 0

    def buffer(self) -> memoryview:
        """Where the next bytes go."""
        if self._big is not None:
            return self._big[self._filled : self._filled + MOST_AT_ONCE]
        if self._begin == self._end:
            self._begin = self._end = 0
        elif self._end == SCRATCH_BYTES:
            rest = self._end - self._begin
            self._view[:rest] = self._view[self._begin : self._end]
            self._begin, self._end = 0, rest
        return self._view[self._end :]

    def received(self, count: int) -> None:
        """``count`` bytes are in the buffer.

        Raises:
            FrameError: the connection is of no use any more.
        """
        if self._big is not None:
            self._filled += count
            if self._filled == len(self._big):
                data, self._big, self._filled = self._big, None, 0
                self._reserve(-self.reserved)
                self.reserved = 0
                self._on_frame(Frame.PUBLISH, self._channel, data)
            return
        self._end += count
        while self._next():
            pass

    def _next(self) -> bool:
        """Takes one frame from the scratch; False: more bytes are needed."""
        at, ready = self._begin, self._end - self._begin
        if ready < _WORDS.size:
            return False
        kind, length = _WORDS.unpack_from(self._scratch, at)
        if not self._greeted:
            if kind != self._hello:
                raise FrameError(
                    f"the peer begins with {kind:08x} instead of {self._hello:08x}: it does not speak TCPQ"
                )
            self._greeted = True
            self._begin += _WORDS.size
            return True
        if not Frame.PUBLISH <= kind <= Frame.UNSUBSCRIBE:
            raise FrameError(f"frame type {kind} does not exist")
        if length > LONGEST_NAME:
            raise FrameError(f"a channel of {length} bytes, {LONGEST_NAME} are possible")
        at += _WORDS.size
        if ready < _WORDS.size + length:
            return False
        try:
            channel = self._scratch[at : at + length].decode()
        except UnicodeDecodeError:
            raise FrameError("a channel that is not text") from None
        at += length
        if kind != Frame.PUBLISH:
            self._begin = at
            self._on_frame(Frame(kind), channel, b"")
            return True
        if self._end - at < _WORD.size:
            return False
        (size,) = _WORD.unpack_from(self._scratch, at)
        if size > self._most:
            raise FrameError(f"a message of {size} bytes, {self._most} are allowed")
        at += _WORD.size
        here = self._end - at
        if here >= size:
            self._begin = at + size
            self._on_frame(Frame.PUBLISH, channel, bytes(self._view[at : at + size]))
            return True
        if at - self._begin + size <= SCRATCH_BYTES // 2:
            return False
        if not self._reserve(size):
            raise FrameError("too much is on its way already")
        self.reserved = size
        # memory that is not touched costs nothing, so a lie about the size is free
        self._big = np.empty(size, np.uint8).data
        self._big[:here] = self._view[at : self._end]
        self._filled = here
        self._channel = channel
        self._begin = self._end = 0
        return False
