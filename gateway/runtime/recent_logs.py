"""The newest log entries of some loggers, kept in memory for interfaces that show them."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import dataclass
from typing import Final

from structlog.typing import EventDict, WrappedLogger

MAX_ENTRIES: Final = 1000
"""Entries per logger; older ones are dropped."""
MAX_MESSAGE: Final = 1000
"""Characters; longer messages are cut. With ``MAX_ENTRIES`` 1 MB per logger."""
_EXCLUDED: Final = frozenset(("event", "level", "logger", "timestamp", "exc_info", "exception", "stack", "request_id"))


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One line of a log."""

    timestamp: float
    """Unix time, seconds."""
    level: str
    """Level by structlog's name: debug, info, warning, error, critical."""
    logger: str
    message: str
    """The event and its values."""


class RecentLogs:
    """A structlog processor that stores entries and returns them unchanged. Thread-safe."""

    def __init__(self, *loggers: str) -> None:
        """
        Args:
            loggers: names of the loggers whose entries are stored.
        """
        self._entries: dict[str, deque[LogEntry]] = {name: deque(maxlen=MAX_ENTRIES) for name in loggers}

    def __call__(self, logger: WrappedLogger, method: str, event: EventDict) -> EventDict:
        """Store the entry; its level and logger must have been added by earlier processors."""
        entries = self._entries.get(event.get("logger", ""))
        if entries is not None:
            values = [f" {key}={value}" for key, value in event.items() if key not in _EXCLUDED]
            message = f"{event.get('event')}{''.join(values)}"[:MAX_MESSAGE]
            entries.append(LogEntry(time.time(), event.get("level", method), event["logger"], message))
        return event

    def entries(self, logger: str) -> list[LogEntry]:
        """Return the entries of a logger, oldest first."""
        return list(self._entries[logger])


recent_logs: Final = RecentLogs("stereo")
"""Newest log entries, filled by ``logs.configure``; shown as the camera's log file over REST."""
