"""``scenegate convert``: write the scene of an LCM log to an MCAP file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, Literal

import typer

MAX_SHOWN: Final = 20
"""Maximum number of warnings that are printed."""


def convert(
    log: Annotated[Path, typer.Argument(metavar="LOG.lcm", exists=True, dir_okay=False, help="LCM log.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.mcap", dir_okay=False, help="File to write.")],
    profile: Annotated[
        Literal["foxglove", "ros2"], typer.Option(help="Messages: Foxglove's schemas, or those of ROS 2.")
    ] = "foxglove",
    root: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FOLDER",
            exists=True,
            file_okay=False,
            help="Folder with the mesh files of messages. Can be repeated.",
        ),
    ] = None,
) -> None:
    """Write the scene of an LCM log to an MCAP file, for Foxglove and ROS 2: Director's messages and Drake's."""
    import asyncio

    from scenegate.cli.record_mcap import check_packages

    check_packages()
    from gateway.assets.mesh_files import MeshFiles
    from gateway.recording.log_to_mcap import convert_log
    from gateway.runtime.kernels.loading import ensure_compiled
    from scenegate.cli.progress_bar import progress_bar
    from scenegate.lcm.event_log import EventLogError

    ensure_compiled(show=True)
    files = MeshFiles(tuple(root or ()))
    with progress_bar("Converting", "messages", log.stat().st_size) as bar:
        try:
            converted = asyncio.run(convert_log(log, out, profile, files, bar.update))
        except EventLogError as error:
            raise ValueError(f"{log}: {error}") from None
    counts = f"{converted.read} messages of the scene, {converted.written} written, {converted.bytes} bytes"
    typer.echo(f"{out}: {counts}", err=True)
    for warning, count in list(converted.warnings.items())[:MAX_SHOWN]:
        typer.echo(f"scenegate: {warning}" + (f" ({count} times)" if count > 1 else ""), err=True)
