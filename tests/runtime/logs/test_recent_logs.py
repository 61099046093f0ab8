"""Log entries that are kept for interfaces: which, how many, how long."""

import logging
from collections.abc import Iterator

import pytest
import structlog

from gateway.runtime.logs import log_setup
from gateway.runtime.logs.recent_logs import MAX_ENTRIES, MAX_MESSAGE, RecentLogs, stereo_log


@pytest.fixture
def handler() -> Iterator[RecentLogs]:
    root, before = logging.getLogger(), (logging.getLogger().handlers[:], logging.getLogger().level)
    log_setup.configure("json")
    log, handler = logging.getLogger("stereo"), RecentLogs()
    log.handlers[:] = [handler]
    yield handler
    log.handlers.clear()
    root.handlers[:] = before[0]
    root.setLevel(before[1])
    structlog.reset_defaults()


def test_entries_of_the_logger_are_kept_with_their_values(handler: RecentLogs) -> None:
    structlog.get_logger("stereo").warning("frame", late=3, request_id="r")
    structlog.get_logger("stereo").debug("below the level")
    structlog.get_logger("gateway").info("other")
    logging.getLogger("stereo").error("of %s", "the standard library")
    frame, other = handler.entries()
    assert frame.timestamp > 1.7e9
    assert (frame.level, frame.logger, frame.message) == ("warning", "stereo", "frame late=3")
    assert (other.level, other.message) == ("error", "of the standard library")


def test_old_entries_are_dropped_and_long_messages_cut(handler: RecentLogs) -> None:
    log = structlog.get_logger("stereo")
    for number in range(MAX_ENTRIES + 1):
        log.info(str(number))
    entries = handler.entries()
    assert (len(entries), entries[0].message, entries[-1].message) == (MAX_ENTRIES, "1", str(MAX_ENTRIES))
    log.info("x" * (MAX_MESSAGE + 1))
    assert handler.entries()[-1].message == "x" * MAX_MESSAGE


def test_the_cameras_log_is_kept(handler: RecentLogs) -> None:
    log_setup.configure("json")
    structlog.get_logger("stereo").info("kept by the configuration")
    assert stereo_log.entries()[-1].message == "kept by the configuration"
