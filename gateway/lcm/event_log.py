"""LCM's log files, as lcm-logger writes and lcm-logplayer reads them: events one behind the other, big endian.

Each is ``sync word, number, time in microseconds, length of the channel, length of the data`` and then both. Source:
lcm/eventlog.c of LCM 1.5.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO, Final

SYNC: Final = 0xEDA1DA01
LONGEST_CHANNEL: Final = 1000
"""Bytes; what lcm/eventlog.c believes."""
MOST_BYTES: Final = 1 << 28
"""Of one message: LCM's own limit."""
_HEAD: Final = struct.Struct(">IqqII")
_LOOK_BYTES: Final = 64 * 1024


class EventLogError(ValueError):
    """The file is not an LCM log."""


@dataclass(frozen=True, slots=True)
class Event:
    """One message of a log."""

    number: int
    time_us: int
    """Microseconds, of the recorder's clock."""
    channel: str
    data: bytes


def pack_event(number: int, time_us: int, channel: str, data: bytes | memoryview) -> bytes:
    """An event as in the file."""
    name = channel.encode()
    return b"".join((_HEAD.pack(SYNC, number, time_us, len(name), len(data)), name, data))


def read_events(file: BinaryIO) -> Iterator[Event]:
    """All whole events; a damaged one is skipped, as is one that a crash of the recorder cut off.

    Raises:
        EventLogError: there is not a single event in the file although it is not empty.
    """
    found = skipped = False
    while True:
        at = file.tell()
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            skipped = skipped or bool(head)
            break
        sync, number, time_us, name_bytes, data_bytes = _HEAD.unpack(head)
        good = sync == SYNC and name_bytes < LONGEST_CHANNEL and data_bytes <= MOST_BYTES
        body = file.read(name_bytes + data_bytes) if good else b""
        if not good or len(body) < name_bytes + data_bytes:
            skipped = True
            if not _seek_sync(file, at + 1):
                break
            continue
        found = True
        yield Event(number, time_us, body[:name_bytes].decode("utf-8", "replace"), body[name_bytes:])
    if skipped and not found:
        raise EventLogError("this is not an LCM log, it has no event")


def _seek_sync(file: BinaryIO, begin: int) -> bool:
    """Goes to the next sync word from ``begin`` on."""
    word = struct.pack(">I", SYNC)
    file.seek(begin)
    while piece := file.read(_LOOK_BYTES):
        place = piece.find(word)
        if place >= 0:
            file.seek(begin + place)
            return True
        if len(piece) < len(word):
            return False
        begin += len(piece) - (len(word) - 1)
        file.seek(begin)
    return False
