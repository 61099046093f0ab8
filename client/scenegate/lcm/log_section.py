"""A section of a log, for playing, and the earlier messages without which its receivers would miss things."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import BinaryIO

from scenegate.lcm.event_log import Event, read_events


class EmptySectionError(ValueError):
    """The log ends before the section begins."""


@dataclass(frozen=True, slots=True)
class StateChannels:
    """Channels whose messages before a section still hold in it, by prefixes of their names."""

    edits: tuple[str, ...] = ()
    """Channels of which every message counts, because it changes what earlier ones have made."""
    values: tuple[str, ...] = ()
    """Channels of which only the last message counts."""


@dataclass(frozen=True, slots=True)
class Section:
    """Section of a log by the recorder's clock."""

    start: float = 0.0
    """Seconds from the log's first message."""
    duration: float | None = None
    """Seconds from the start; None: to the end of the log."""
    before: StateChannels = StateChannels()
    """Channels of the earlier messages that are played first."""


def section_events(
    file: BinaryIO, section: Section, wanted: Callable[[str], bool] = lambda channel: True
) -> Iterator[tuple[float | None, Event]]:
    """Yield the events of a section with their times in seconds from its start, as recorded.

    Earlier messages of ``section.before`` come first, in the order of the log, with None as their time. Others are not
    read: that part of the log costs only the reading of its headers.

    Args:
        file: log file at its begin.
        wanted: returns False for channels that are left out.

    Raises:
        EventLogError: the file is not empty, but has no complete event.
        EmptySectionError: the section begins after the end of the log.
    """
    edits, values = section.before.edits, section.before.values
    last_values: dict[str, int] = {}
    """Positions of the last messages of ``values`` by channel."""
    first_us: int | None = None
    seconds, is_inside = 0.0, False

    def is_read(channel: str) -> bool:
        return (is_inside or channel.startswith(edits)) and wanted(channel)

    for event in read_events(file, is_read):
        first_us = event.time_us if first_us is None else first_us
        seconds = (event.time_us - first_us) / 1e6 - section.start
        if not is_inside and seconds >= 0.0:
            is_inside = True
            for earlier in _events_at(file, [*sorted(last_values.values()), event.position]):
                if earlier.position < event.position:
                    yield None, earlier
                else:
                    event = earlier  # the same event with its data
        if is_inside and section.duration is not None and seconds >= section.duration:
            return
        if not wanted(event.channel):
            continue
        if is_inside:
            yield seconds, event
        elif event.channel.startswith(edits):
            yield None, event
        elif event.channel.startswith(values):
            last_values[event.channel] = event.position
    if section.start and not is_inside:
        raise EmptySectionError(f"the log has {seconds + section.start:.1f} s, and nothing at {section.start:g} s")


def _events_at(file: BinaryIO, positions: list[int]) -> Iterator[Event]:
    """Yield the events at these positions, then return to the file's position."""
    after = file.tell()
    for position in positions:
        file.seek(position)
        yield from islice(read_events(file), 1)
    file.seek(after)
