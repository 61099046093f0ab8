"""Recording what passes on an LCM network, and playing it again."""

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
from gateway.lcm.network import Bus, join, url_of
from gateway.lcm.tcpq_transport import TcpqBus
from gateway.lcm.udpm_transport import UdpmBus

CONNECT_SECONDS: Final = 10.0
MOST_UNSENT_BYTES: Final = 16 * 1024 * 1024
"""Waiting for a network when played faster than it takes."""
NOBODY: Final = "SCENEGATE_PLAYS_ONLY"
"""A beginning of channels that nobody uses."""
EARLY_SECONDS: Final = 0.001
"""Events due so soon are sent at once: a sleep takes longer."""


@dataclass(slots=True)
class Tally:
    """Of a recording or playing."""

    events: int = 0
    data_bytes: int = 0


async def _joined(url: str | None, prefix: str, receive: Callable[[str, bytes | memoryview], None]) -> Bus:
    bus = join(url_of(url), prefix, LcmConfig())
    if isinstance(bus, TcpqBus):
        connected = asyncio.Event()
        bus.start(receive, connected.set)
        try:
            async with asyncio.timeout(CONNECT_SECONDS):
                await connected.wait()
        except TimeoutError:
            problem = bus.status().get("warning", "")
            await bus.close()
            raise ConnectionError(f"LCM cannot join {bus.url}: {problem}") from None
    else:
        bus.start(receive)
    return bus


async def _left(bus: Bus) -> None:
    if isinstance(bus, TcpqBus):
        await bus.close()
    else:
        bus.close()


async def record(
    out: Path,
    url: str | None,
    channels: str,
    tally: Tally,
    stop: asyncio.Event,
    ready: Callable[[], None] = lambda: None,
) -> None:
    """Writes messages to a log until ``stop``; each is on its way to the disk when the next one comes.

    Args:
        url: of the network; None: LCM_DEFAULT_URL, or LCM's default.
        channels: pattern that must match a channel as a whole.
        ready: called when what is sent from now on will be recorded.
    Raises:
        LcmUnavailable, ConnectionError, OSError, ValueError: in one sentence.
    """
    try:
        wanted = re.compile(channels)
    except re.error as error:
        raise ValueError(f"--channels {channels!r} is not a pattern: {error}") from None
    with out.open("wb") as file:

        def arrived(channel: str, data: bytes | memoryview) -> None:
            if wanted.fullmatch(channel):
                file.write(pack_event(tally.events, time.time_ns() // 1000, channel, data))
                file.flush()
                tally.events += 1
                tally.data_bytes += len(data)

        bus = await _joined(url, "", arrived)
        try:
            ready()
            await stop.wait()
        finally:
            await _left(bus)


async def play(path: Path, url: str | None, speed: float, loop: bool, channels: str, tally: Tally) -> None:
    """Publishes a log's messages, in time.

    Args:
        speed: 2 is twice as fast as recorded; 0: as fast as possible.
        loop: again and again, until cancelled.
        channels: pattern that must match a channel as a whole.
    Raises:
        EventLogError, LcmUnavailable, ConnectionError, OSError, ValueError: in one sentence.
    """
    wanted = re.compile(channels)
    bus = await _joined(url, NOBODY, lambda channel, data: None)
    try:
        while True:
            before = tally.events
            await _play_once(path, bus, speed, wanted, tally)
            if not loop or tally.events == before:
                break
        if isinstance(bus, TcpqBus | UdpmBus):
            await bus.drained(0)
        if isinstance(bus, TcpqBus):
            await bus.finish()
    finally:
        await _left(bus)


async def _play_once(path: Path, bus: Bus, speed: float, wanted: re.Pattern[str], tally: Tally) -> None:
    begin: tuple[float, int] | None = None
    with path.open("rb") as file:
        for event in read_events(file):
            if not wanted.fullmatch(event.channel):
                continue
            if begin is None:
                begin = time.monotonic(), event.time_us
            if speed > 0.0:
                due = begin[0] + (event.time_us - begin[1]) / 1e6 / speed - time.monotonic()
                if due > EARLY_SECONDS:
                    await asyncio.sleep(due)
            if isinstance(bus, TcpqBus | UdpmBus):
                await bus.drained(MOST_UNSENT_BYTES)
            bus.publish(event.channel, event.data)
            tally.events += 1
            tally.data_bytes += len(event.data)
            if tally.events % 64 == 0:
                await asyncio.sleep(0)
