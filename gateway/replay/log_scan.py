"""One pass over the headers of a log: its times and channels, without decoding a message."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.replay.log_replay import LogClock, is_shown
from scenegate.lcm.event_log import EventLogError, read_events
from scenegate.regular_files import open_regular

REPORT_EVENTS: Final = 4096
"""Number of events between two calls of ``on_progress``."""
MAX_CHANNELS: Final = 4096
"""Maximum number of channels that are counted by name."""
MAX_NAMED: Final = 10
"""Maximum number of channels that an error names."""


class LogError(ValueError):
    """A log cannot be shown; the message is one sentence."""


@dataclass(frozen=True, slots=True)
class LogSummary:
    """Span, counts and damage of a log."""

    span: tuple[int, int]
    """Times of the first and last event on the time bar, nanoseconds since the epoch."""
    events: int
    """Number of events."""
    shown: int
    """Number of events of channels that change the tree, among the first ``MAX_CHANNELS`` channels."""
    file_bytes: int
    """Size of the file when it was read."""
    clock_sets: int
    """Number of times that the recorder's clock was set."""
    damaged_bytes: int = 0
    """Bytes that belong to no complete message: the recorder was killed, or the file is damaged."""


def scan_log(path: Path, on_progress: Callable[[int], None] = lambda position: None) -> LogSummary:
    """Read the headers of all events of a log. ``on_progress`` is called now and then with the bytes read so far.

    Raises LogError if it is not an LCM log, or none of its messages can be shown; or OSError.
    """
    clock = LogClock()
    first_ns = events = 0
    channels: Counter[str] = Counter()
    damages: list[int] = []
    with open_regular(path) as file:
        try:
            for event in read_events(file, lambda channel: False, damages.append):  # only their headers
                clock = clock.after(event.time_us)
                if not events:
                    first_ns = clock.time_ns
                events += 1
                if event.channel in channels or len(channels) < MAX_CHANNELS:
                    channels[event.channel] += 1
                if events % REPORT_EVENTS == 0:
                    on_progress(event.position)
        except EventLogError as error:
            raise LogError(f"{path}: {error}") from None
        file_bytes = file.tell()
    shown = sum(count for channel, count in channels.items() if is_shown(channel))
    if not shown:
        raise LogError(f"{path}: {_nothing_to_show(events, channels)}")
    return LogSummary((first_ns, clock.time_ns), events, shown, file_bytes, clock.sets, sum(damages))


def _nothing_to_show(events: int, channels: Counter[str]) -> str:
    if not events:
        return "the log is empty"
    names = ", ".join(f"{name[:60]} ({count})" for name, count in channels.most_common(MAX_NAMED))
    more = f" and {len(channels) - MAX_NAMED} more" if len(channels) > MAX_NAMED else ""
    return (
        "no channel of the log can be shown: there are neither requests of the tree viewer's clients "
        f"(DIRECTOR_TREE_VIEWER_REQUEST…) nor messages of Drake (DRAKE_VIEWER_…), only {names}{more}"
    )
