"""``scenegate stream``: receive the image sets of Scenegate's stereo camera or of a real rc_visard."""

import argparse
import contextlib
from pathlib import Path

from scenegate.cli.options import add_access, at_least, pop_credentials
from scenegate.cli.output import print_note
from scenegate.cli.progress_bar import progress_bar


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's arguments and options."""
    add = parser.add_argument
    add("target", metavar="HOST:PORT", help="address of the camera; the default port is 50051")
    add_image = parser.add_argument_group("images", "Default: left and disparity.").add_argument
    for flag, help_text in (
        ("--left", "left image"),
        ("--right", "right image"),
        ("--disparity", "disparity image"),
        ("--error", "disparity error image"),
        ("--confidence", "confidence image"),
        ("--mesh", "mesh, as PLY"),
        ("--color", "left and right in colour"),
        ("--color-camera", "image of the colour camera"),
        ("--depth", "depth in millimetres, 16 bits"),
        ("--aligned", "with --depth: as seen by the colour camera"),
    ):
        add_image(flag, action="store_true", help=help_text)
    help_text = "maximum number of points of a mesh, at least 1000; 0: no limit (default: 0)"
    add_image("--max-points", type=at_least(0), default=0, metavar="N", help=help_text)
    help_text = "take the nearest point of each bin of a mesh instead of the mean"
    add_image("--min-depth", action="store_true", help=help_text)
    add_image("--watertight", action="store_true", help="mesh without holes")
    add_image("--textured", action="store_true", help="mesh with colours")
    add_file = parser.add_argument_group("files").add_argument
    help_text = "write PNG, PLY, npz and parameter files for cvkit there"
    add_file("-o", "--out", type=Path, metavar="FOLDER", help=help_text)
    help_text = "with -o: write exposure time, gain, noise and brightness of each image"
    add_file("--exposure", action="store_true", help=help_text)
    help_text = "with -o: write the GPIOs of each image, and their bits in the file names"
    add_file("--gpio", action="store_true", help=help_text)
    help_text = "with -o: write exact depth and labels of each set, from this gateway's HTTP port http://HOST:PORT"
    add_file("--truth", metavar="URL", help=help_text)
    help_text = "number of the camera of --truth, if there are several (default: 0)"
    add_file("--pipeline", type=at_least(0), default=0, metavar="N", help=help_text)
    help_text = "image of the newest set, all images side by side, disparity in colours"
    add_file("--preview", type=Path, metavar="FILE", help=help_text)
    help_text = "end after this number of sets; 0: when interrupted (default: 0)"
    add("--count", type=at_least(0), default=0, metavar="N", help=help_text)
    help_text = "end with an error after this number of seconds; 0: never (default: 0)"
    add("--timeout", type=at_least(0.0), default=0.0, metavar="SECONDS", help=help_text)
    add_access(parser)


def run(options: argparse.Namespace) -> None:
    """Receive image sets."""
    from scenegate.camera.stream import Progress, StreamOptions, receive_all

    values = vars(options)
    output = values.pop("out")
    if output is None and (values["exposure"] or values["gpio"] or values["truth"]):
        raise argparse.ArgumentTypeError("--exposure, --gpio and --truth need -o FOLDER")
    credentials = pop_credentials(values)
    timeout = values.pop("timeout") or None
    stream = StreamOptions(**values, output=output, credentials=credentials, timeout=timeout)
    newest = Progress()  # the last one of ``report``, if Ctrl+C ends ``receive_all``
    unit = f"of {stream.count} sets" if stream.count else "sets"
    with contextlib.suppress(KeyboardInterrupt), progress_bar("Receiving", unit, stream.count or None) as bar:

        def report(progress: Progress) -> None:
            # On a terminal there is a bar, otherwise one line per second.
            nonlocal newest
            newest = progress
            bar.update(progress.sets, count=progress.sets, note=f"newest {progress.timestamp}")
            if not bar.shown and progress.second_passed():
                print_note(progress.line())

        newest = receive_all(stream, report)
    print_note(newest.line())
