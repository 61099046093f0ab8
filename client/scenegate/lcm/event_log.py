"""Read and write LCM's log files, the format of lcm-logger and lcm-logplayer, for ``replay``.

A file is a sequence of events. An event has ``sync word, number, time in microseconds, channel length, data length`` as
big-endian integers, then the channel and the data. Source: lcm/eventlog.c of LCM 1.5.
"""

import io
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
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
    position: int = field(default=0, compare=False)
    """Offset in the file, bytes."""


def pack_event(number: int, time_us: int, channel: str, data: bytes | memoryview) -> bytes:
    """Return an event as the bytes of a log file."""
    name = channel.encode()
    return b"".join((_HEADER.pack(SYNC, number, time_us, len(name), len(data)), name, data))


def read_events(
    file: BinaryIO,
    wanted: Callable[[str], bool] = lambda channel: True,
    on_damage: Callable[[int], object] = lambda size: None,
) -> Iterator[Event]:
    """Yield all complete events from the position of a log file to its end. Damaged and truncated parts are skipped.

    Events of channels that are not ``wanted`` have empty data. ``on_damage`` gets the bytes of each part that is
    skipped. Raises EventLogError if the file is not empty, but has no complete event.
    """
    position = begin = file.tell()
    has_events = has_damage = False
    while True:
        header = file.read(_HEADER.size)
        if len(header) < _HEADER.size:
            if header:
                has_damage = True
                on_damage(len(header))
            break
        sync, number, time_us, name_bytes, data_bytes = _HEADER.unpack(header)
        is_header = sync == SYNC and name_bytes <= MAX_CHANNEL_BYTES and data_bytes <= MAX_DATA_BYTES
        body = _read_body(file, name_bytes, data_bytes, wanted) if is_header else None
        if body is None:
            has_damage = True
            is_found = _seek_sync(file, position + 1)
            end = file.tell() if is_found else file.seek(0, io.SEEK_END)
            on_damage(end - position)
            if not is_found:
                break
            position = end
            continue
        has_events = True
        channel, data = body
        yield Event(number, time_us, channel, data, position)
        position += _HEADER.size + name_bytes + data_bytes
    if has_damage and not has_events and begin == 0:
        raise EventLogError("this is not an LCM log, it has no event")


def _read_body(
    file: BinaryIO, name_bytes: int, data_bytes: int, wanted: Callable[[str], bool]
) -> tuple[str, bytes] | None:
    """Return channel and data of an event, b"" for channels that are not wanted; None if the file ends too early."""
    if not _has(file, name_bytes + data_bytes):
        return None
    name = file.read(name_bytes)
    if len(name) < name_bytes:
        return None
    channel = name.decode("utf-8", "replace")
    if not wanted(channel):
        return (channel, b"") if _skip(file, data_bytes) else None
    data = file.read(data_bytes)
    return (channel, data) if len(data) == data_bytes else None


def _skip(file: BinaryIO, size: int) -> bool:
    """Skip bytes of a file; return False if it has fewer. The last one is read: seeking beyond the end is no error."""
    if size > 0:
        file.seek(size - 1, io.SEEK_CUR)
    return size == 0 or bool(file.read(1))


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


class EmptySectionError(ValueError):
    """The log ends before the section begins."""


@dataclass(frozen=True, slots=True)
class StateChannels:
    """Channels whose messages before a section still hold in it, by prefixes of their names."""

    edit_prefixes: tuple[str, ...] = ()
    """Channels of which every message counts, because it changes what earlier ones have made."""
    value_prefixes: tuple[str, ...] = ()
    """Channels of which only the last message counts."""


@dataclass(frozen=True, slots=True)
class Section:
    """Section of a log by the recorder's clock."""

    start: float = 0.0
    """Seconds from the log's first message."""
    duration: float | None = None
    """Seconds from the start; None: to the end of the log."""
    state_channels: StateChannels = StateChannels()
    """Channels of the earlier messages that are played first."""


def section_events(
    file: BinaryIO, section: Section, wanted: Callable[[str], bool] = lambda channel: True
) -> Iterator[tuple[float | None, Event]]:
    """Yield the events of a section with their times in seconds from its start, as recorded.

    Earlier messages of ``section.state_channels`` come first, with None as their time: all edits, then the last values,
    both in the order of the log. Of other earlier messages, and of channels that are not ``wanted``, only the headers
    are read. Raises EventLogError, or EmptySectionError if the section begins after the end of the log.
    """
    channels = section.state_channels
    last_values: dict[str, int] = {}
    """Positions of the last messages of values by channel."""
    first_us: int | None = None
    log_seconds = 0.0
    section_position: int | None = None
    for event in read_events(file, lambda channel: channel.startswith(channels.edit_prefixes) and wanted(channel)):
        first_us = event.time_us if first_us is None else first_us
        log_seconds = (event.time_us - first_us) / 1e6
        if log_seconds >= section.start:
            section_position = event.position
            break
        if not wanted(event.channel):
            continue
        if event.channel.startswith(channels.edit_prefixes):
            yield None, event
        elif event.channel.startswith(channels.value_prefixes):
            last_values[event.channel] = event.position
    if first_us is None:
        return
    if section_position is None:
        raise EmptySectionError(f"the log has {log_seconds:.1f} s, and nothing at {section.start:g} s")
    for position in sorted(last_values.values()):
        file.seek(position)
        yield None, next(read_events(file))
    file.seek(section_position)
    for event in read_events(file, wanted):
        seconds = (event.time_us - first_us) / 1e6 - section.start
        if section.duration is not None and seconds >= section.duration:
            return
        if wanted(event.channel):
            yield seconds, event
