"""A section of a log, for playing, and the earlier messages without which its receivers would miss things."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import BinaryIO

from scenegate.lcm.event_log import Event, read_events


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
    both in the order of the log. Of other earlier messages only the headers are read.

    Args:
        file: log file at its begin.
        wanted: returns False for channels that are left out.

    Raises:
        EventLogError: the file is not empty, but has no complete event.
        EmptySectionError: the section begins after the end of the log.
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
