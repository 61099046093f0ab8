"""Build and parse the datagrams of LCM's UDP multicast. ``udpm_sender`` and ``udpm_assembler`` use it.

A short message is one datagram: ``LC02, sequence, channel\\0, data``. A long message is a series of fragments, each in
one datagram: ``LC03, sequence, message size, offset, index, number of fragments``, then a part of the data. The first
fragment has ``channel\\0`` before its data. Integers are big-endian. Source: lcm/udpm_util.h and lcm/lcm_udpm.c of
LCM 1.5.
"""

import struct
from collections.abc import Iterator
from typing import Final, NamedTuple

SHORT_MAGIC: Final = b"LC02"
LONG_MAGIC: Final = b"LC03"
MAX_SHORT_BYTES: Final = 65_499
"""Maximum bytes of channel, NUL and data in one datagram (LCM_SHORT_MESSAGE_MAX_SIZE)."""
MAX_FRAGMENT_BYTES: Final = 65_487
"""Maximum payload of one fragment (LCM_FRAGMENT_MAX_PAYLOAD)."""
MAX_FRAGMENTS: Final = 65_535
"""Maximum number of fragments of one message."""
MAX_CHANNEL_BYTES: Final = 63
"""Maximum length of a channel name (LCM_MAX_CHANNEL_NAME_LENGTH)."""
MAX_DATAGRAM_BYTES: Final = 65_536
"""Size of the buffer for a datagram: more than UDP can carry."""

_SHORT_HEADER: Final = struct.Struct(">4sI")
_FRAGMENT_HEADER: Final = struct.Struct(">4sIIIHH")


class UdpmMessage(NamedTuple):
    """A complete message."""

    channel: str
    data: bytes | memoryview


class Fragment(NamedTuple):
    """One fragment of a long message."""

    sequence: int
    message_size: int
    """Bytes of the whole message."""
    offset: int
    """Position of ``payload`` in the message, in bytes."""
    fragment_index: int
    """Index of the fragment in the message."""
    fragment_count: int
    """Number of fragments of the message."""
    channel: bytes | None
    """Channel name; only the first fragment has it."""
    payload: memoryview


def datagrams(channel: str, data: bytes | bytearray, sequence: int) -> Iterator[list[bytes | bytearray | memoryview]]:
    """Yield the datagrams of a message, each as a list of buffers for ``sendmsg``.

    Raises ValueError if the channel name is too long, or the message needs more fragments than can be numbered.
    """
    name = channel.encode() + b"\0"
    if len(name) > MAX_CHANNEL_BYTES + 1:
        raise ValueError(
            f"LCM's channel names have at most {MAX_CHANNEL_BYTES} characters, {channel!r} has {len(name) - 1}"
        )
    if len(name) + len(data) <= MAX_SHORT_BYTES:
        yield [_SHORT_HEADER.pack(SHORT_MAGIC, sequence), name, data]
        return
    count = -(-(len(name) + len(data)) // MAX_FRAGMENT_BYTES)
    if count > MAX_FRAGMENTS:
        raise ValueError(f"LCM cannot send {len(data)} bytes in one message")
    view = memoryview(data)
    offset = 0
    for index in range(count):
        header = _FRAGMENT_HEADER.pack(LONG_MAGIC, sequence, len(data), offset, index, count)
        size = MAX_FRAGMENT_BYTES - (len(name) if index == 0 else 0)
        yield [header, *([name] if index == 0 else []), view[offset : offset + size]]
        offset += size


def parse_short(datagram: bytes, prefixes: tuple[bytes, ...]) -> UdpmMessage | None:
    """Return the message in a short datagram; None if it is malformed, or its channel has none of the ``prefixes``."""
    begin = _SHORT_HEADER.size
    if not datagram.startswith(prefixes, begin):
        return None
    end = _channel_end(datagram, begin)
    return None if end < 0 else UdpmMessage(datagram[begin:end].decode("utf-8", "replace"), datagram[end + 1 :])


def parse_fragment(datagram: bytes) -> Fragment | None:
    """Return the fragment in a datagram, or None if it is malformed."""
    begin = _FRAGMENT_HEADER.size
    if len(datagram) < begin:
        return None
    _, sequence, size, offset, index, count = _FRAGMENT_HEADER.unpack_from(datagram)
    channel = None
    if index == 0:
        end = _channel_end(datagram, begin)
        if end < 0:
            return None
        channel, begin = datagram[begin:end], end + 1
    payload = memoryview(datagram)[begin:]
    if index >= count or offset + len(payload) > size:
        return None
    return Fragment(sequence, size, offset, index, count, channel, payload)


def _channel_end(datagram: bytes, begin: int) -> int:
    """Return the position of the NUL after the channel name, or -1."""
    return datagram.find(0, begin, begin + MAX_CHANNEL_BYTES + 1)
