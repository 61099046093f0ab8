"""``scenegate play``: play a log file into an LCM network."""

import argparse
import asyncio
import logging
from typing import Final

from scenegate.cli.options import add_channels, add_lcm_url, at_least, existing_file
from scenegate.cli.output import print_note
from scenegate.cli.progress_bar import progress_bar
from scenegate.cli.record import run_with_bar
from scenegate.lcm import replay
from scenegate.lcm.event_log import Section, StateChannels
from scenegate.messages import wire

STATE_CHANNELS: Final = StateChannels(edit_prefixes=(wire.REQUEST,), value_prefixes=("DRAKE_", "CONTACT_RESULTS"))
"""Channels of a viewer: requests build on each other, and each message of Drake's replaces the one before."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments and options."""
    parser.add_argument("log", metavar="IN.lcmlog", type=existing_file, help="the log")
    add_lcm_url(parser)
    help_text = (
        "begin this long after the log's first message. Earlier requests to the tree viewer, and the last message "
        "of each channel of Drake's, are played first, at once (default: 0)"
    )
    parser.add_argument("--start", type=at_least(0.0), metavar="SECONDS", default=0.0, help=help_text)
    help_text = "end this long after the start, by the recorded times (default: the log's end)"
    parser.add_argument("--duration", type=at_least(0.0), metavar="SECONDS", help=help_text)
    help_text = "2: twice as fast; 0: as fast as possible (default: 1)"
    parser.add_argument("--rate", type=at_least(0.0), default=1.0, help=help_text)
    parser.add_argument("--loop", action="store_true", help="repeat until interrupted")
    add_channels(parser)


def run(options: argparse.Namespace) -> None:
    """Play the log."""
    logging.basicConfig(format="scenegate: %(message)s")
    log, progress = options.log, replay.LogProgress()
    section = Section(options.start, options.duration, STATE_CHANNELS)
    play_options = replay.PlayOptions(options.rate, section, options.loop, options.channels)

    async def play() -> None:
        with progress_bar("Playing", "messages", log.stat().st_size) as bar:
            playing = replay.play(log, options.lcm_url, play_options, progress)
            await run_with_bar(playing, lambda: bar.update(progress.position, progress.events))

    try:
        asyncio.run(play())
    except ValueError as error:
        raise ValueError(f"{log}: {error}") from None
    except KeyboardInterrupt:
        pass
    print_note(f"{log}: {progress.events} messages played, {progress.data_bytes} bytes")
