"""Read and write LCM's log files, the format of lcm-logger and lcm-logplayer. ``replay`` uses both functions.

A file is a sequence of events. An event has ``sync word, number, time in microseconds, channel length, data length`` as
big-endian integers, then the channel and the data. Source: lcm/eventlog.c of LCM 1.5.
"""

from __future__ import annotations

import io
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO, Final

SYNC: Final = 0xEDA1DA01
"""Sync word: the first bytes of each event."""
MAX_CHANNEL_BYTES: Final = 999
"""Maximum length of a channel name. A longer one counts as damage, as in lcm/eventlog.c."""
MAX_DATA_BYTES: Final = 1 << 28
"""Maximum size of one message: LCM's own limit."""
_HEADER: Final = struct.Struct(">IqqII")
_SEARCH_BYTES: Final = 64 * 1024
"""Bytes read at a time in the search for a sync word."""


class EventLogError(ValueError):
    """The file is not an LCM log."""


@dataclass(frozen=True, slots=True)
class Event:
    """One message of a log."""

    number: int
    """Number of earlier events in the recording."""
    time_us: int
    """Time of reception by the recorder's clock, in microseconds."""
    channel: str
    data: bytes


def pack_event(number: int, time_us: int, channel: str, data: bytes | memoryview) -> bytes:
    """Return an event as the bytes of a log file."""
    name = channel.encode()
    return b"".join((_HEADER.pack(SYNC, number, time_us, len(name), len(data)), name, data))


def read_events(file: BinaryIO) -> Iterator[Event]:
    """Yield all complete events of a log file. Damaged and truncated parts are skipped.

    Raises:
        EventLogError: the file is not empty, but has no complete event.
    """
    has_events = has_damage = False
    while True:
        position = file.tell()
        header = file.read(_HEADER.size)
        if len(header) < _HEADER.size:
            has_damage = has_damage or bool(header)
            break
        sync, number, time_us, name_bytes, data_bytes = _HEADER.unpack(header)
        valid = sync == SYNC and name_bytes <= MAX_CHANNEL_BYTES and data_bytes <= MAX_DATA_BYTES
        valid = valid and _has(file, name_bytes + data_bytes)
        body = file.read(name_bytes + data_bytes) if valid else b""
        if not valid or len(body) < name_bytes + data_bytes:
            has_damage = True
            if not _seek_sync(file, position + 1):
                break
            continue
        has_events = True
        yield Event(number, time_us, body[:name_bytes].decode("utf-8", "replace"), body[name_bytes:])
    if has_damage and not has_events:
        raise EventLogError("this is not an LCM log, it has no event")


def _has(file: BinaryIO, size: int) -> bool:
    """Return True if a file may have ``size`` more bytes. To read the rest at each fault would be quadratic."""
    if size <= _SEARCH_BYTES:
        return True
    position = file.tell()
    end = file.seek(0, io.SEEK_END)
    file.seek(position)
    return end - position >= size


def _seek_sync(file: BinaryIO, position: int) -> bool:
    """Seek to the first sync word at or after ``position``; return False if there is none."""
    word = struct.pack(">I", SYNC)
    file.seek(position)
    while chunk := file.read(_SEARCH_BYTES):
        index = chunk.find(word)
        if index >= 0:
            file.seek(position + index)
            return True
        if len(chunk) < len(word):
            return False
        position += len(chunk) - (len(word) - 1)
        file.seek(position)
    return False
