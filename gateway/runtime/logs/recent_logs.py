"""The newest log entries of a logger, kept in memory for interfaces that show them."""

import logging
from collections import deque
from dataclasses import dataclass
from typing import Final

MAX_ENTRIES: Final = 1000
"""Maximum number of entries; older ones are dropped."""
MAX_MESSAGE: Final = 1000
"""Characters; longer messages are cut. With ``MAX_ENTRIES`` 1 MB."""
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


class RecentLogs(logging.Handler):
    """Handler of a logger that keeps the newest entries of structlog. Thread-safe."""

    def __init__(self) -> None:
        super().__init__()
        self._entries: deque[LogEntry] = deque(maxlen=MAX_ENTRIES)

    def emit(self, record: logging.LogRecord) -> None:
        """Keep an entry."""
        event = record.msg if isinstance(record.msg, dict) else {"event": record.getMessage()}
        values = [f" {key}={value}" for key, value in event.items() if key not in _EXCLUDED]
        message = f"{event.get('event')}{''.join(values)}"[:MAX_MESSAGE]
        self._entries.append(LogEntry(record.created, record.levelname.lower(), record.name, message))

    def entries(self) -> list[LogEntry]:
        """Return the entries, oldest first."""
        return list(self._entries)


stereo_log: Final = RecentLogs()
"""Newest entries of the logger ``stereo``, to which ``logs.configure`` adds it; the camera's log file over REST."""
