"""``scenegate record``: write an LCM network's messages to a log file. ``record_mcap`` writes MCAP files instead."""

import argparse
import asyncio
import contextlib
import logging
import signal
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any, Final

from scenegate.cli import record_mcap
from scenegate.cli.options import add_channels, add_lcm_url, at_least
from scenegate.cli.output import print_note
from scenegate.cli.progress_bar import progress_bar
from scenegate.lcm import replay

UPDATE_SECONDS: Final = 0.2
"""Time between two updates of the progress bar."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments and options."""
    help_text = "the log of an LCM network; an existing file is replaced"
    parser.add_argument("out", metavar="OUT.lcmlog", type=Path, nargs="?", help=help_text)
    add_lcm_url(parser)
    add_channels(parser)
    help_text = (
        "stop after this time, with --mcap from the first message of each source on; 0: when interrupted (default: 0)"
    )
    parser.add_argument("--seconds", type=at_least(0.0), default=0.0, help=help_text)
    record_mcap.add_arguments(parser)


def run(options: argparse.Namespace) -> None:
    """Record until the time is over, or the command is interrupted."""
    outputs = [path for path in (options.out, options.mcap) if path is not None]
    if len(outputs) != 1:
        raise argparse.ArgumentTypeError("one of OUT.lcmlog and --mcap OUT.mcap is needed, not both")
    record_mcap.check_mode(options)
    if options.mcap is not None:
        record_mcap.run(options)
        return
    logging.basicConfig(format="scenegate: %(message)s")
    progress = replay.LogProgress()

    async def record_log() -> None:
        stop = asyncio.Event()
        loop = asyncio.get_running_loop()
        with contextlib.suppress(NotImplementedError):  # on Windows, Ctrl+C raises KeyboardInterrupt
            for signal_number in (signal.SIGINT, signal.SIGTERM):
                loop.add_signal_handler(signal_number, stop.set)
        if options.seconds:
            loop.call_later(options.seconds, stop.set)
        begin = loop.time()
        with progress_bar("Recording", "messages", options.seconds or None) as bar:

            def announce_start() -> None:
                if not bar.shown:  # the bar says it on a terminal
                    print_note("Recording ...")

            recording = replay.record(options.out, options.lcm_url, options.channels, progress, stop, announce_start)
            await run_with_bar(recording, lambda: bar.update(loop.time() - begin, progress.events))

    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(record_log())
    print_note(f"{options.out}: {progress.events} messages, {progress.data_bytes} bytes")
    if progress.lost:
        print_note(f"scenegate: lost: {progress.lost}")


async def run_with_bar(work: Coroutine[Any, Any, None], update_bar: Callable[[], None]) -> None:
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
