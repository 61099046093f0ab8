"""``scenegate record --mcap``: write the live scene and a camera's images to MCAP files."""

from __future__ import annotations

import argparse
import importlib
import signal
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from scenegate.cli.options import add_access, at_least, pop_credentials
from scenegate.cli.output import print_note
from scenegate.cli.progress_bar import progress_bar

if TYPE_CHECKING:
    from scenegate.recording.recorder import RecordingOptions, SceneWriter

DEFAULT_GATEWAY: Final = "http://127.0.0.1:8000"
MIN_FILE_MB: Final = 1.0
"""Minimum size of a file, megabytes: that of one piece, ``mcap_file.CHUNK_BYTES``."""
NEEDED: Final = ("mcap", "mcap_protobuf", "mcap_ros2", "foxglove_schemas_protobuf", "websockets", "grpc")
"""Packages of the extra ``mcap``."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of recordings to MCAP files."""
    add = parser.add_argument_group("MCAP files", "Live scene and images, for Foxglove and ROS 2.").add_argument
    help_text = "file to write, which is replaced, instead of an LCM log"
    add("--mcap", type=Path, metavar="OUT.mcap", help=help_text)
    help_text = "messages: Foxglove's schemas, or those of ROS 2 (default: foxglove)"
    add("--profile", choices=("foxglove", "ros2"), default="foxglove", help=help_text)
    help_text = f"address of the gateway (default: {DEFAULT_GATEWAY})"
    add("--gateway", metavar="URL", default=DEFAULT_GATEWAY, help=help_text)
    help_text = "record the gateway's live scene, with Drake's channels (default: --scene)"
    add("--scene", action=argparse.BooleanOptionalAction, default=True, help=help_text)
    help_text = "record left and right images of this stereo camera, and depth at its own rate; default port: 50051"
    add("--camera", metavar="HOST:PORT", help=help_text)
    help_text = "with --camera: record disparity, depth and points, too (default: --depth)"
    add("--depth", action=argparse.BooleanOptionalAction, default=True, help=help_text)
    add("--color", action="store_true", help="with --camera: left and right in colour")
    help_text = "begin a new file, OUT_1.mcap, OUT_2.mcap, after this many megabytes, at least 1; 0: never (default: 0)"
    add("--max-mb", type=at_least(0.0), default=0.0, metavar="MB", help=help_text)
    help_text = "with --max-mb: keep only this number of files, the newest ones; 0: all (default: 0)"
    add("--keep", type=at_least(0), default=0, metavar="N", help=help_text)
    add_access(parser)


def check_mode(options: argparse.Namespace) -> None:
    """Raise ``argparse.ArgumentTypeError`` for an option of the other kind of file."""
    if options.mcap is None:
        given = {
            "--camera": options.camera,
            "--color": options.color,
            "--no-depth": not options.depth,
            "--no-scene": not options.scene,
            "--max-mb": options.max_mb,
            "--keep": options.keep,
            "--profile": options.profile != "foxglove",
            "--gateway": options.gateway != DEFAULT_GATEWAY,
        }
        kind = "an MCAP file: --mcap OUT.mcap"
    else:
        given = {"--lcm-url": options.lcm_url, "--channels": options.channels != ".*"}
        kind = "an LCM log: OUT.lcmlog"
    wrong = [name for name, is_given in given.items() if is_given]
    if wrong:
        raise argparse.ArgumentTypeError(f"{', '.join(wrong)} needs {kind}")


def run(options: argparse.Namespace) -> None:
    """Record until the time is over, or the command is interrupted."""
    check_packages()
    from scenegate.recording.recorder import record

    recording = _recording(options)
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    begin = time.monotonic()
    shown: set[str] = set()
    print_note("Recording ...")
    with progress_bar("Recording", "messages", options.seconds or None) as bar:

        def report(writer: SceneWriter) -> None:
            seconds = time.monotonic() - begin
            bar.update(seconds, writer.files.messages, note=f"{writer.files.size / 1e6:.1f} MB")
            for warning in writer.warnings:
                if warning not in shown:
                    shown.add(warning)
                    print_note(f"scenegate: {warning}")

        writer = record(recording, stop, report)
    files = ", ".join(map(str, writer.files.paths))
    print_note(f"{files}: {writer.files.messages} messages, {writer.files.bytes} bytes")


def check_packages() -> None:
    """Raise ImportError with a remedy if a package of the extra ``mcap`` is not installed."""
    for name in NEEDED:
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise ImportError(f"{error}: MCAP files need pip install 'scenegate-client[mcap]'") from None


def _recording(options: argparse.Namespace) -> RecordingOptions:
    """Return what is recorded; raise ``argparse.ArgumentTypeError`` if that is nothing."""
    from scenegate.camera.stream import StreamOptions
    from scenegate.recording.recorder import RecordingOptions

    if not (options.scene or options.camera):
        raise argparse.ArgumentTypeError("nothing is recorded: --no-scene needs --camera")
    if 0.0 < options.max_mb < MIN_FILE_MB:
        raise argparse.ArgumentTypeError(
            f"--max-mb is {options.max_mb:g}; it must be 0, or at least {MIN_FILE_MB:g}: messages are written in "
            "pieces of about a megabyte"
        )
    if options.mcap.is_dir():
        raise argparse.ArgumentTypeError(f"--mcap: {str(options.mcap)!r} is a folder, not a file")
    if options.keep and not options.max_mb:
        raise argparse.ArgumentTypeError("--keep needs --max-mb")
    credentials = pop_credentials(vars(options))
    camera = None
    if options.camera is not None:
        camera = StreamOptions(options.camera, color=options.color, credentials=credentials)
    return RecordingOptions(
        options.mcap,
        options.profile,
        scene=options.gateway if options.scene else None,
        camera=camera,
        credentials=credentials,
        max_bytes=int(options.max_mb * 1e6),
        keep=options.keep,
        depth=options.depth,
        seconds=options.seconds,
    )
