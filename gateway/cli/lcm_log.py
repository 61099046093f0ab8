"""``scenegate record`` and ``scenegate play``: log files of an LCM network, in the format of LCM's own tools."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from gateway.runtime.progress_bar import progress_bar

UPDATE_SECONDS: Final = 0.2
"""Time between two updates of the progress bar."""

LcmUrl = Annotated[
    str | None,
    typer.Option(
        "--lcm-url", metavar="URL", help="tcpq://HOST:PORT, udpm://...; default: LCM_DEFAULT_URL, or LCM's default."
    ),
]
Channels = Annotated[str, typer.Option(metavar="PATTERN", help="Only channels whose whole name matches.")]


def record(
    out: Annotated[Path, typer.Argument(metavar="OUT.lcmlog", help="The log; an existing file is replaced.")],
    lcm_url: LcmUrl = None,
    channels: Channels = ".*",
    seconds: Annotated[float, typer.Option(min=0.0, help="Stop after this time; 0: when interrupted.")] = 0.0,
) -> None:
    """Record an LCM network, for lcm-logplayer, lcm-spy and `scenegate play`."""
    from gateway.lcm import replay
    from gateway.runtime import logs

    logs.configure("human", "warning")
    progress = replay.Progress()

    async def run() -> None:
        stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, stop.set)
        if seconds:
            loop.call_later(seconds, stop.set)
        begin = loop.time()
        with progress_bar("Recording", "messages", seconds or None) as bar:

            def ready() -> None:
                if not bar.shown:
                    typer.echo("Recording ...", err=True)

            recording = replay.record(out, lcm_url, channels, progress, stop, ready)
            await _run_with_bar(recording, lambda: bar.update(loop.time() - begin, progress.events))

    asyncio.run(run())
    typer.echo(f"{out}: {progress.events} messages, {progress.data_bytes} bytes", err=True)


def play(
    log: Annotated[Path, typer.Argument(metavar="IN.lcmlog", exists=True, dir_okay=False, help="The log.")],
    lcm_url: LcmUrl = None,
    speed: Annotated[float, typer.Option(min=0.0, help="2: twice as fast; 0: as fast as possible.")] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Repeat until interrupted.")] = False,
    channels: Channels = ".*",
) -> None:
    """Play a log into an LCM network."""
    from gateway.lcm import replay
    from gateway.lcm.event_log import EventLogError
    from gateway.runtime import logs

    logs.configure("human", "warning")
    progress = replay.Progress()

    async def run() -> None:
        with progress_bar("Playing", "messages", log.stat().st_size) as bar:
            playing = replay.play(log, lcm_url, speed, loop, channels, progress)
            await _run_with_bar(playing, lambda: bar.update(progress.position, progress.events))

    try:
        asyncio.run(run())
    except EventLogError as error:
        raise ValueError(f"{log}: {error}") from None
    except KeyboardInterrupt:
        pass
    typer.echo(f"{log}: {progress.events} messages played, {progress.data_bytes} bytes", err=True)


async def _run_with_bar(work: Coroutine[Any, Any, None], update_bar: Callable[[], None]) -> None:
    """Run ``work``, and call ``update_bar`` every ``UPDATE_SECONDS`` until it ends."""

    async def update_repeatedly() -> None:
        while True:
            update_bar()
            await asyncio.sleep(UPDATE_SECONDS)

    task = asyncio.create_task(update_repeatedly())
    try:
        await work
    finally:
        task.cancel()
