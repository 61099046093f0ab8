"""Record an LCM network to a log file, and play a log file into a network, for the command line."""

import asyncio
import re
import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, BinaryIO, Final

from scenegate.lcm.event_log import Section, pack_event, section_events
from scenegate.lcm.network import open_transport, resolve_url
from scenegate.lcm.transport import LcmMessage, OnMessage, Transport, TransportLimits
from scenegate.regular_files import errors_name, open_regular

CONNECT_SECONDS: Final = 10.0
"""Timeout for the connection to the network."""
DRAIN_SECONDS: Final = 2.0
"""Maximum time in which a recording that ends writes what has arrived; it ends when nothing waits to be read."""
MAX_UNSENT_BYTES: Final = 16 * 1024 * 1024
"""Maximum bytes queued for sending. Reading of the log pauses until the network has taken more."""
UNUSED_PREFIX: Final = "SCENEGATE_PLAYS_ONLY"
"""Prefix of no channel: a transport must have one, also to receive nothing."""
MIN_SLEEP_SECONDS: Final = 0.001
"""Events that are due within this time are sent at once, because shorter sleeps are inaccurate."""
MIN_LOOP_SECONDS: Final = 0.1
"""Minimum time between the begins of two repetitions: a log of one message has no length."""
MAX_NAMED_CHANNELS: Final = 10
"""Maximum number of channels that an error names."""
YIELD_EVENTS: Final = 64
"""Number of events sent before the event loop continues."""


@dataclass(slots=True)
class LogProgress:
    """Events recorded or played so far."""

    events: int = 0
    """Number of events."""
    data_bytes: int = 0
    """Bytes of data in the events."""
    position: int = 0
    """Bytes of the log file that were read, in its current repetition."""
    lost: str = ""
    """Losses of a recording, in words; empty: none."""


async def record(
    path: Path,
    url: str | None,
    channels: str,
    progress: LogProgress,
    stop: asyncio.Event,
    on_ready: Callable[[], None] = lambda: None,
) -> None:
    """Write messages to a log until ``stop`` is set and what had arrived is written. Each one is flushed at once.

    The file is replaced once the network of the URL (None: LCM_DEFAULT_URL, or LCM's default) is joined; then
    ``on_ready`` is called. ``channels`` must match the whole channel name. Raises LcmUnavailableError, ConnectionError,
    OSError, or ValueError if ``channels`` is no regular expression.
    """
    pattern = _pattern(channels)
    write_error: OSError | None = None
    file: BinaryIO | None = None

    def on_message(message: LcmMessage) -> None:
        nonlocal write_error
        if file is None or write_error is not None or not pattern.fullmatch(message.channel):
            return
        arrival_us = message.arrival // 1000
        try:
            file.write(pack_event(progress.events, arrival_us, message.channel, message.data))
            file.flush()
        except OSError as error:  # the disk is full
            write_error = error
            stop.set()
            return
        progress.events += 1
        progress.data_bytes += len(message.data)

    # The file is opened after the connection, without which an earlier log stays, and closed after it has ended.
    with errors_name(path), ExitStack() as open_file:
        async with _open_connected(url, on_message) as transport:
            file = open_file.enter_context(path.open("wb"))
            on_ready()
            await stop.wait()
            deadline = time.monotonic() + DRAIN_SECONDS
            while transport.status().get("unread_bytes") and time.monotonic() < deadline:  # noqa: ASYNC110 - there is no event
                await asyncio.sleep(MIN_SLEEP_SECONDS)
            progress.lost = _lost(transport.status())
        if write_error is not None:
            raise write_error


def _lost(status: Mapping[str, Any]) -> str:
    """Return what a transport has lost, by its counters, in words."""
    names = {
        "lost_datagrams": "datagrams that came faster than they were read",
        "incomplete": "messages of which datagrams are missing",
        "dropped": "messages since too many were waiting",
    }
    return ", ".join(f"{status[counter]} {name}" for counter, name in names.items() if status.get(counter))


@dataclass(frozen=True, slots=True)
class PlayOptions:
    """Section of a log to play, its speed and its channels."""

    rate: float = 1.0
    """2: twice as fast as recorded; 0: as fast as possible."""
    section: Section = field(default_factory=Section)
    loop: bool = False
    """True: repeat until cancelled."""
    channels: str = ".*"
    """Regular expression that must match the whole channel name."""


async def play(path: Path, url: str | None, options: PlayOptions, progress: LogProgress) -> None:
    """Publish a log's messages, with the time between them as recorded. URL as for ``record``.

    Raises LcmUnavailableError, ConnectionError, EventLogError or OSError; ValueError if ``options.channels`` is no
    regular expression or matches no channel, a name or message does not fit into the network, or the log ends before
    the section.
    """
    pattern = _pattern(options.channels)
    async with _open_connected(url) as transport:
        while True:
            events_before = progress.events
            repetition_start = time.monotonic()
            await _play_once(path, transport, options, pattern, progress)
            is_empty = progress.events == events_before
            if not options.loop or is_empty:
                break
            if options.rate > 0.0:
                await asyncio.sleep(max(0.0, repetition_start + MIN_LOOP_SECONDS - time.monotonic()))
        await transport.finish()


async def _play_once(
    path: Path, transport: Transport, options: PlayOptions, pattern: re.Pattern[str], progress: LogProgress
) -> None:
    """Publish the section's messages once; raise ValueError if it has channels, but none that matches."""
    unmatched: set[str] = set()
    """Some channels that do not match, for the error."""

    def is_wanted(channel: str) -> bool:
        matches = pattern.fullmatch(channel) is not None
        if not matches and len(unmatched) < MAX_NAMED_CHANNELS:
            unmatched.add(channel)
        return matches

    section_start: float | None = None
    """``time.monotonic()`` at second 0 of the section; None before the first message in it."""
    with open_regular(path) as file:
        for seconds, event in section_events(file, options.section, is_wanted):
            if seconds is not None and options.rate > 0.0:  # None: a message before the section, published at once
                now, seconds_after_start = time.monotonic(), seconds / options.rate
                if section_start is None:
                    section_start = now - seconds_after_start  # so that the first message is due at once
                delay = section_start + seconds_after_start - now
                if delay > MIN_SLEEP_SECONDS:
                    await asyncio.sleep(delay)
            await transport.drain(MAX_UNSENT_BYTES)
            transport.publish(event.channel, event.data)
            progress.events += 1
            progress.data_bytes += len(event.data)
            progress.position = file.tell()
            if progress.events % YIELD_EVENTS == 0:
                await asyncio.sleep(0)
    if unmatched and not progress.events:
        names = ", ".join(sorted(unmatched)) + (" and others" if len(unmatched) == MAX_NAMED_CHANNELS else "")
        raise ValueError(f"no channel matches --channels {options.channels!r}; there are {names}")


def _pattern(channels: str) -> re.Pattern[str]:
    """Return the pattern of ``--channels``. Raises ValueError if it is not a regular expression."""
    try:
        return re.compile(channels)
    except re.error as error:
        raise ValueError(f"--channels {channels!r} is not a pattern: {error}") from None


@asynccontextmanager
async def _open_connected(url: str | None, on_message: OnMessage | None = None) -> AsyncIterator[Transport]:
    """Open a transport and wait until it is connected. It receives all channels, or none without ``on_message``."""
    prefix = "" if on_message is not None else UNUSED_PREFIX
    transport = open_transport(resolve_url(url), (prefix,), TransportLimits())
    connected = asyncio.Event()
    transport.start(on_message or (lambda message: None), connected.set)
    try:
        try:
            await asyncio.wait_for(connected.wait(), CONNECT_SECONDS)
        except asyncio.TimeoutError:
            reason = transport.status().get("warning", "")
            raise ConnectionError(f"LCM cannot join {transport.url}: {reason}") from None
        yield transport
    finally:
        await transport.close()
