"""``scenegate convert``: write the scene of an LCM log to an MCAP file."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from gateway.cli.log_files import MeshRoot, open_log_file, print_warnings
from scenegate.cli.output import print_note


def convert(
    log: Annotated[Path, typer.Argument(metavar="LOG", exists=True, dir_okay=False, help="LCM log.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.mcap", dir_okay=False, help="File to write.")],
    profile: Annotated[
        Literal["foxglove", "ros2"], typer.Option(help="Messages: Foxglove's schemas, or those of ROS 2.")
    ] = "foxglove",
    mesh_root: MeshRoot = "auto",
) -> None:
    """Write the scene of an LCM log to an MCAP file, for Foxglove and ROS 2: Director's messages and Drake's."""
    import asyncio

    from scenegate.cli.record_mcap import check_packages

    check_packages()
    from gateway.replay.log_to_mcap import convert_log
    from gateway.runtime.kernels.parts import ensure_compiled
    from scenegate.cli.progress_bar import progress_bar

    if out.exists() and out.samefile(log):
        raise ValueError(f"{out} is the log itself; the MCAP file needs another name")
    with open_log_file(log, mesh_root) as timeline:
        ensure_compiled(show=True)
        with progress_bar("Converting", "messages", timeline.summary.file_bytes) as bar:
            converted = asyncio.run(convert_log(timeline, out, profile, bar.update))
    counts = f"{converted.read} messages of the scene, {converted.written} written, {converted.bytes} bytes"
    print_note(f"{out}: {counts}")
    print_warnings(log, converted.warnings)
