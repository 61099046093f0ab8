"""Build and parse the frames of TCPQ, LCM over TCP. ``tcpq_hub`` and ``tcpq_transport`` use it.

Client and hub each send a magic number and a version first, the hello. Then they send frames: ``type, length, channel``
and, for messages, ``length, data``. Integers are big-endian uint32. The client subscribes with patterns and publishes;
the hub sends the messages that match. Source: lcm/lcm_tcpq.c and TCPProvider.java of LCM 1.5.
"""

import asyncio
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
MAX_CHANNEL_BYTES: Final = 999
"""Maximum length of a relayed message's channel name. TCPQ has no limit, but LCM's log files have this one."""
MAX_PATTERN_BYTES: Final = 2 * MAX_CHANNEL_BYTES
"""Maximum length of a subscription's pattern: a channel name with every character escaped."""
MAX_NAME_BYTES: Final = 64 * 1024
"""Maximum length of a channel name or pattern in a frame. A peer that sends a longer one does not speak TCPQ."""
MAX_READ_BYTES: Final = 512 * 1024
"""Maximum bytes of a big message read before the event loop continues: they take about 0.2 ms."""
MAX_JOINED_BYTES: Final = 16 * 1024
"""Maximum size of messages that are copied behind their header, to be sent in one packet."""
SCRATCH_BYTES: Final = 256 * 1024
"""Size of the buffer for frames. A message of more than half of it is big: it is read into memory of its own."""

_UINT: Final = struct.Struct(">I")
_TWO_UINTS: Final = struct.Struct(">II")


class FrameType(IntEnum):
    """Type of a frame."""

    PUBLISH = 1
    SUBSCRIBE = 2
    UNSUBSCRIBE = 3


class FrameError(ValueError):
    """The peer does not speak TCPQ, or exceeds a limit. The connection cannot be used any more."""


def publish_header(channel: str, size: int) -> bytes:
    """Return the bytes of a PUBLISH frame that precede its ``size`` bytes of data."""
    name = channel.encode()
    return b"".join((_TWO_UINTS.pack(FrameType.PUBLISH, len(name)), name, _UINT.pack(size)))


def publish(transport: asyncio.WriteTransport, channel: str, message: bytes | bytearray | memoryview) -> None:
    """Write a PUBLISH frame."""
    header = publish_header(channel, len(message))
    if len(message) <= MAX_JOINED_BYTES:
        transport.write(b"".join((header, message)))
    else:
        transport.write(header)
        transport.write(memoryview(message))


def subscription_frame(frame_type: FrameType, pattern: str) -> bytes:
    """Return a SUBSCRIBE or UNSUBSCRIBE frame."""
    name = pattern.encode()
    return _TWO_UINTS.pack(frame_type, len(name)) + name


class FrameParser:
    """Splits a byte stream into frames. Big messages are not copied.

    The caller reads bytes into ``buffer()``, then calls ``received()`` with their number.
    """

    def __init__(
        self,
        magic: int,
        max_message: int,
        on_frame: Callable[[FrameType, str, memoryview | bytes], None],
        reserve: Callable[[int], bool] = lambda size: True,
        release: Callable[[int], None] = lambda size: None,
    ) -> None:
        """Create a parser for one connection, whose peer must send ``magic`` first.

        ``on_frame`` is called with type, channel or pattern, and data, whose memory is not reused. ``reserve`` is
        called with the size of a big message before its data is read, and returns False to refuse it; ``release`` when
        it is complete, or by ``close``.
        """
        self._magic = magic
        self._max_message = max_message
        self._on_frame = on_frame
        self._reserve = reserve
        self._release = release
        self._scratch = bytearray(SCRATCH_BYTES)
        self._scratch_view = memoryview(self._scratch)
        self._parsed_end = 0
        """Number of bytes in ``_scratch`` that have been parsed."""
        self._received_end = 0
        """Number of bytes in ``_scratch`` that have been received."""
        self._hello_received = False
        self._big_channel = ""
        self._big_message: memoryview | None = None
        self._big_received = 0

    def buffer(self) -> memoryview:
        """Return the memory for the next bytes."""
        if self._big_message is not None:
            return self._big_message[self._big_received : self._big_received + MAX_READ_BYTES]
        if self._parsed_end == self._received_end:
            self._parsed_end = self._received_end = 0
        elif self._received_end == SCRATCH_BYTES:
            unparsed = self._received_end - self._parsed_end
            self._scratch_view[:unparsed] = self._scratch_view[self._parsed_end : self._received_end]
            self._parsed_end, self._received_end = 0, unparsed
        return self._scratch_view[self._received_end :]

    def received(self, count: int) -> None:
        """Parse ``count`` bytes that were written to ``buffer()``. Raises FrameError for others, or above a limit."""
        if self._big_message is not None:
            self._big_received += count
            if self._big_received == len(self._big_message):
                data = self._big_message
                self.close()
                self._on_frame(FrameType.PUBLISH, self._big_channel, data)
            return
        self._received_end += count
        while self._parse_frame():
            pass

    def close(self) -> None:
        """Release the memory of a big message that is being read, if there is one."""
        if self._big_message is not None:
            self._release(len(self._big_message))
            self._big_message = None

    def _parse_frame(self) -> bool:
        """Parse the hello or one frame; return False if more bytes are needed."""
        position, available = self._parsed_end, self._received_end - self._parsed_end
        if available < _TWO_UINTS.size:
            return False
        frame_type, name_bytes = _TWO_UINTS.unpack_from(self._scratch, position)
        if not self._hello_received:
            if frame_type != self._magic:
                raise FrameError(
                    f"the peer begins with {frame_type:08x} instead of {self._magic:08x}: it does not speak TCPQ"
                )
            self._hello_received = True
            self._parsed_end += _TWO_UINTS.size
            return True
        if not FrameType.PUBLISH <= frame_type <= FrameType.UNSUBSCRIBE:
            raise FrameError(f"frame type {frame_type} does not exist")
        if name_bytes > MAX_NAME_BYTES:
            raise FrameError(f"a channel of {name_bytes} bytes, {MAX_NAME_BYTES} are possible")
        position += _TWO_UINTS.size
        if available < _TWO_UINTS.size + name_bytes:
            return False
        try:
            channel = self._scratch[position : position + name_bytes].decode()
        except UnicodeDecodeError:
            raise FrameError("a channel that is not text") from None
        position += name_bytes
        if frame_type != FrameType.PUBLISH:
            self._parsed_end = position
            self._on_frame(FrameType(frame_type), channel, b"")
            return True
        if self._received_end - position < _UINT.size:
            return False
        (size,) = _UINT.unpack_from(self._scratch, position)
        if size > self._max_message:
            raise FrameError(f"a message of {size} bytes, {self._max_message} are allowed")
        position += _UINT.size
        if self._received_end - position >= size:
            self._parsed_end = position + size
            self._on_frame(FrameType.PUBLISH, channel, bytes(self._scratch_view[position : position + size]))
            return True
        if position - self._parsed_end + size > SCRATCH_BYTES // 2:
            self._start_big_message(channel, size, position)
        return False

    def _start_big_message(self, channel: str, size: int, position: int) -> None:
        """Read a message of ``size`` bytes, whose data begins at ``position``, into memory of its own."""
        if not self._reserve(size):
            raise FrameError("too much is on its way already")
        # the kernel allocates pages when they are written, so a false size costs no memory
        self._big_message = np.empty(size, np.uint8).data
        self._big_received = self._received_end - position
        self._big_message[: self._big_received] = self._scratch_view[position : self._received_end]
        self._big_channel = channel
        self._parsed_end = self._received_end = 0
