"""``scenegate record`` and ``scenegate play``: logs of an LCM network, as LCM's own tools read and write them."""

from __future__ import annotations

import asyncio
import signal
from pathlib import Path
from typing import Annotated

import typer

LcmUrl = Annotated[
    str | None,
    typer.Option(
        "--lcm-url", metavar="URL", help="tcpq://HOST:PORT, udpm://...; default: LCM_DEFAULT_URL, or LCM's default."
    ),
]
Channels = Annotated[str, typer.Option(metavar="PATTERN", help="Only channels that match as a whole.")]


def record(
    out: Annotated[Path, typer.Argument(metavar="OUT.lcmlog", help="The log; one that is there is replaced.")],
    lcm_url: LcmUrl = None,
    channels: Channels = ".*",
    seconds: Annotated[float, typer.Option(min=0.0, help="End after so long; 0: when interrupted.")] = 0.0,
) -> None:
    """Record an LCM network, for lcm-logplayer, lcm-spy and `scenegate play`."""
    from gateway.lcm import replay
    from gateway.runtime import logs

    logs.configure("human", "warning")
    tally = replay.Tally()

    async def run() -> None:
        stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stop.set)
        if seconds:
            loop.call_later(seconds, stop.set)
        await replay.record(out, lcm_url, channels, tally, stop, lambda: typer.echo("Recording ...", err=True))

    asyncio.run(run())
    typer.echo(f"{out}: {tally.events} messages, {tally.data_bytes} bytes", err=True)


def play(
    log: Annotated[Path, typer.Argument(metavar="IN.lcmlog", exists=True, dir_okay=False, help="The log.")],
    lcm_url: LcmUrl = None,
    speed: Annotated[float, typer.Option(min=0.0, help="2: twice as fast; 0: as fast as possible.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Again and again, until interrupted.")] = False,
    channels: Channels = ".*",
) -> None:
    """Play a log into an LCM network."""
    from gateway.lcm import replay
    from gateway.lcm.event_log import EventLogError
    from gateway.runtime import logs

    logs.configure("human", "warning")
    tally = replay.Tally()
    try:
        asyncio.run(replay.play(log, lcm_url, speed, loop, channels, tally))
    except EventLogError as error:
        raise ValueError(f"{log}: {error}") from None
    except KeyboardInterrupt:
        pass
    typer.echo(f"{log}: {tally.events} messages played, {tally.data_bytes} bytes", err=True)
