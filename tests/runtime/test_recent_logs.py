"""Log entries that are kept for interfaces: which, how many, how long."""

from __future__ import annotations

import time

import pytest

from gateway.runtime.recent_logs import MAX_ENTRIES, MAX_MESSAGE, RecentLogs


def test_entries_of_the_named_loggers_are_kept_with_their_values(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "time", lambda: 12.5)
    logs = RecentLogs("stereo", "view")
    event = {"event": "frame", "logger": "stereo", "level": "warning", "late": 3, "request_id": "r", "timestamp": "t"}
    assert logs(None, "warn", dict(event)) == event
    logs(None, "info", {"event": "other", "logger": "gateway"})
    logs(None, "info", {"event": "no logger"})
    (entry,) = logs.entries("stereo")
    assert (entry.timestamp, entry.level, entry.logger, entry.message) == (12.5, "warning", "stereo", "frame late=3")
    assert logs.entries("view") == []


def test_the_level_defaults_to_the_method() -> None:
    logs = RecentLogs("stereo")
    logs(None, "info", {"event": "frame", "logger": "stereo"})
    assert logs.entries("stereo")[0].level == "info"


def test_old_entries_are_dropped_and_long_messages_cut() -> None:
    logs = RecentLogs("stereo")
    for number in range(MAX_ENTRIES + 1):
        logs(None, "info", {"event": str(number), "logger": "stereo"})
    entries = logs.entries("stereo")
    assert (len(entries), entries[0].message, entries[-1].message) == (MAX_ENTRIES, "1", str(MAX_ENTRIES))
    logs(None, "info", {"event": "x" * (MAX_MESSAGE + 1), "logger": "stereo"})
    assert logs.entries("stereo")[-1].message == "x" * MAX_MESSAGE
