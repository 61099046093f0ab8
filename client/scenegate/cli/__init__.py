"""The command ``scenegate``. Commands import lazily, and every expected error is one sentence without a traceback."""

import argparse
import os
import re
import signal
import sys
import threading
from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import entry_points
from typing import Final

from scenegate.cli import standard_streams
from scenegate.cli.output import ArgumentParser
from scenegate.name_hint import name_hint
from scenegate.printable import printable

CLIENT_COMMANDS: Final = {
    "publish": ("scenegate.cli.publish", "Publish a file at a path of a viewer's live scene."),
    "stream": ("scenegate.cli.stream", "Receive image sets of a stereo camera, Scenegate's or a real rc_visard."),
    "record": ("scenegate.cli.record", "Record an LCM network, or the live scene and a camera for Foxglove and ROS 2."),
    "play": ("scenegate.cli.play", "Play a log into an LCM network."),
}
"""Modules with ``add_arguments`` and ``run``, and the first lines of their descriptions."""
SERVER_COMMANDS: Final = {
    "serve": "Serve all protocols until SIGTERM or Ctrl+C.",
    "view": "Show an LCM log in the browser, at any time of it.",
    "render": "Render scenes: one image, or a dataset of images, camera parameters and labels.",
    "export": "Write a scene and its motion into one file.",
    "dataset": "Commands for datasets written by `scenegate render`, and for scenarios.",
    "convert": "Write the scene of an LCM log to an MCAP file, for Foxglove and ROS 2.",
    "doctor": "Find what does not work, what that means and what to do.",
    "warmup": "Compile the rendering kernels into the cache, so that the next start is fast.",
}
"""Commands of the server's distribution, which it has entry points for."""
INTERRUPTED: Final = 130
"""Exit status of shells after SIGINT."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; the console script calls this."""
    standard_streams.prepare()
    # A terminal that closes ends a command as SIGTERM does, except under nohup. Only the main thread may set handlers.
    if (
        sys.platform != "win32"
        and threading.current_thread() is threading.main_thread()
        and signal.getsignal(signal.SIGHUP) is signal.SIG_DFL
    ):
        signal.signal(signal.SIGHUP, lambda *_: signal.raise_signal(signal.SIGTERM))
    arguments = sys.argv[1:] if arguments is None else arguments
    name = arguments[0] if arguments else "--help"
    try:
        if name in SERVER_COMMANDS:
            _run_of_server(name, arguments)
        elif name.endswith("-completion") or "_SCENEGATE_COMPLETE" in os.environ:
            _run_of_server("serve", arguments)  # Typer completes words, those of the server's commands
        elif name in CLIENT_COMMANDS:
            parser = command_parser(name)
            options, unknown = parser.parse_known_args(arguments[1:])
            if unknown:
                hint = name_hint(unknown[0], re.findall(r"--[\w-]+", parser.format_usage()))
                parser.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
            try:
                import_module(CLIENT_COMMANDS[name][0]).run(options)
            except argparse.ArgumentTypeError as error:  # options that do not go together
                parser.error(str(error))
        else:
            known = (*CLIENT_COMMANDS, *SERVER_COMMANDS, "--help", "--version")
            if name not in (*known, "-h"):
                _parser().error(f"there is no command {name!r}{name_hint(name, known)}")
            _parser().parse_args([name])
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except MemoryError as error:
        sys.exit(f"scenegate: there is too little memory: {error}")
    except (OSError, ValueError, RuntimeError, ImportError) as error:
        if isinstance(error, BrokenPipeError) and standard_streams.reader_has_ended():  # as in ``scenegate … | head``
            sys.exit(1)
        sys.exit(printable(f"scenegate: {_sentence(error)}"))
    finally:
        standard_streams.flush()


def command_parser(name: str) -> argparse.ArgumentParser:
    """Return the parser of a command of the client."""
    module, description = CLIENT_COMMANDS[name]
    parser = ArgumentParser(f"scenegate {name}", description=description, allow_abbrev=False)
    import_module(module).add_arguments(parser)
    return parser


def _parser() -> argparse.ArgumentParser:
    """Return the parser of the command without a known subcommand, for its help, its version and its errors."""
    from scenegate import __version__

    helps = {name: text for name, (_, text) in CLIENT_COMMANDS.items()} | SERVER_COMMANDS
    parser = ArgumentParser(
        "scenegate",
        description="Drake's glTF render server, an rc_visard stereo camera and Director's tree viewer, on one scene.",
        epilog="serve, view, render, export, dataset, convert, doctor, warmup need the server: pip install scenegate",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"scenegate {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for name, text in helps.items():
        commands.add_parser(name, help=text)
    return parser


def _sentence(error: Exception) -> str:
    """Return the message of an error, without the system's number of it."""
    if not isinstance(error, OSError) or not error.strerror:
        return str(error)
    return error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"


def _run_of_server(name: str, arguments: Sequence[str]) -> None:
    found = list(entry_points(group="scenegate.commands", name=name))
    if not found:
        raise ImportError(f"`scenegate {name}` needs the server, which is not installed: pip install scenegate")
    try:
        run = found[0].load()
    except ImportError as error:
        raise ImportError(f"{error}; `scenegate doctor` says what is wrong with the installation") from None
    run(arguments)
