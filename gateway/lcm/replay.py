"""Record an LCM network to a log file, and play a log file into a network."""

from __future__ import annotations

import asyncio
import re
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.lcm.config import LcmConfig
from gateway.lcm.event_log import pack_event, read_events
from gateway.lcm.network import open_transport, resolve_url
from gateway.lcm.transport import OnMessage, Transport

CONNECT_SECONDS: Final = 10.0
MAX_UNSENT_BYTES: Final = 16 * 1024 * 1024
"""Maximum bytes queued for a network that takes messages more slowly than the log is read."""
UNUSED_PREFIX: Final = "SCENEGATE_PLAYS_ONLY"
"""Prefix of no channel: a transport that only sends receives nothing."""
MIN_SLEEP_SECONDS: Final = 0.001
"""Events due sooner are sent at once, because a shorter sleep is inaccurate."""
YIELD_EVENTS: Final = 64
"""Events sent before the event loop continues."""


@dataclass(slots=True)
class Progress:
    """Number of events recorded or played so far."""

    events: int = 0
    data_bytes: int = 0


async def record(
    path: Path,
    url: str | None,
    channels: str,
    progress: Progress,
    stop: asyncio.Event,
    on_ready: Callable[[], None] = lambda: None,
) -> None:
    """Write messages to a log until ``stop`` is set. Each is flushed to the file at once.

    Args:
        url: LCM URL; None: LCM_DEFAULT_URL, or LCM's default.
        channels: regular expression that must match the whole channel name.
        on_ready: called when messages are being recorded.
    Raises:
        LcmUnavailableError, ConnectionError, OSError, ValueError: with the reason in one sentence.
    """
    try:
        pattern = re.compile(channels)
    except re.error as error:
        raise ValueError(f"--channels {channels!r} is not a pattern: {error}") from None
    with path.open("wb") as file:

        def on_message(channel: str, data: bytes | memoryview) -> None:
            if pattern.fullmatch(channel):
                file.write(pack_event(progress.events, time.time_ns() // 1000, channel, data))
                file.flush()
                progress.events += 1
                progress.data_bytes += len(data)

        transport = await _connect(url, "", on_message)
        try:
            on_ready()
            await stop.wait()
        finally:
            await transport.close()


async def play(path: Path, url: str | None, speed: float, loop: bool, channels: str, progress: Progress) -> None:
    """Publish a log's messages at the times at which they were recorded.

    Args:
        speed: 2 is twice as fast as recorded; 0: as fast as possible.
        loop: repeat until cancelled.
        channels: regular expression that must match the whole channel name.
    Raises:
        EventLogError, LcmUnavailableError, ConnectionError, OSError, ValueError: with the reason in one sentence.
    """
    pattern = re.compile(channels)
    transport = await _connect(url, UNUSED_PREFIX, lambda channel, data: None)
    try:
        while True:
            events_before = progress.events
            await _play_once(path, transport, speed, pattern, progress)
            if not loop or progress.events == events_before:
                break
        await transport.finish()
    finally:
        await transport.close()


async def _play_once(
    path: Path, transport: Transport, speed: float, pattern: re.Pattern[str], progress: Progress
) -> None:
    start: float | None = None  # of time.monotonic(), and of the recorder's clock
    start_us = 0
    with path.open("rb") as file:
        for event in read_events(file):
            if not pattern.fullmatch(event.channel):
                continue
            if start is None:
                start, start_us = time.monotonic(), event.time_us
            if speed > 0.0:
                delay = start + (event.time_us - start_us) / 1e6 / speed - time.monotonic()
                if delay > MIN_SLEEP_SECONDS:
                    await asyncio.sleep(delay)
            await transport.drain(MAX_UNSENT_BYTES)
            transport.publish(event.channel, event.data)
            progress.events += 1
            progress.data_bytes += len(event.data)
            if progress.events % YIELD_EVENTS == 0:
                await asyncio.sleep(0)


async def _connect(url: str | None, prefix: str, on_message: OnMessage) -> Transport:
    transport = open_transport(resolve_url(url), prefix, LcmConfig())
    connected = asyncio.Event()
    transport.start(on_message, connected.set)
    try:
        async with asyncio.timeout(CONNECT_SECONDS):
            await connected.wait()
    except TimeoutError:
        problem = transport.status().get("warning", "")
        await transport.close()
        raise ConnectionError(f"LCM cannot join {transport.url}: {problem}") from None
    return transport
