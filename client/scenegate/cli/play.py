"""``scenegate play``: play a log file into an LCM network."""

from __future__ import annotations

import argparse
import asyncio
import logging
import sys

from scenegate.cli.options import add_channels, add_lcm_url, at_least, existing_file
from scenegate.cli.progress_bar import progress_bar
from scenegate.cli.record import run_with_bar
from scenegate.lcm import replay
from scenegate.lcm.event_log import EventLogError


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments and options."""
    parser.add_argument("log", metavar="IN.lcmlog", type=existing_file, help="the log")
    add_lcm_url(parser)
    text = "2: twice as fast; 0: as fast as possible (default: 1)"
    parser.add_argument("--speed", type=at_least(0.0), default=1.0, help=text)
    parser.add_argument("--loop", action="store_true", help="repeat until interrupted")
    add_channels(parser)


def run(options: argparse.Namespace) -> None:
    """Play the log."""
    logging.basicConfig(format="scenegate: %(message)s")
    log, progress = options.log, replay.Progress()

    async def play() -> None:
        with progress_bar("Playing", "messages", log.stat().st_size) as bar:
            playing = replay.play(log, options.lcm_url, options.speed, options.loop, options.channels, progress)
            await run_with_bar(playing, lambda: bar.update(progress.position, progress.events))

    try:
        asyncio.run(play())
    except EventLogError as error:
        raise ValueError(f"{log}: {error}") from None
    except KeyboardInterrupt:
        pass
    print(f"{log}: {progress.events} messages played, {progress.data_bytes} bytes", file=sys.stderr)
