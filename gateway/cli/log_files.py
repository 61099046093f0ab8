"""LCM logs of the commands ``view``, ``export`` and ``convert``: their option, how they are opened, their warnings."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from scenegate.cli.output import print_note

if TYPE_CHECKING:
    from gateway.replay.log_timeline import LogTimeline
    from gateway.runtime.settings import Settings

MeshRoot: TypeAlias = Annotated[
    str,
    typer.Option(
        "--mesh-root",
        metavar="FOLDERS",
        help="Folders with the mesh files that messages of a log name; auto: the log's own folder, and ROS packages.",
    ),
]


def open_log_file(path: Path, mesh_root: str) -> LogTimeline:
    """Open a log; a progress bar shows that its headers are read. ``mesh_root`` is as the setting.

    Raises ``typer.BadParameter`` (also for the environment), LogError if nothing of the file can be shown, or OSError.
    """
    from gateway.files.assets.mesh_files import MeshFiles
    from gateway.replay.log_timeline import open_log
    from scenegate.cli.progress_bar import progress_bar
    from scenegate.robots.ros_packages import folders_of_environment

    settings = load_settings({"host": "127.0.0.1", "mesh_root": mesh_root})
    folders = settings.mesh_folders
    if settings.local_clients_read_all_folders:  # auto: the author of a log must not choose other files
        folders = (path.resolve().parent, *folders, *folders_of_environment())
    files = MeshFiles(folders)
    with progress_bar("Reading", "MB", path.stat().st_size) as bar:
        log = open_log(path, files, lambda position: bar.update(position, position // 1_000_000))
    summary = log.summary
    if summary.damaged_bytes:
        text = f"{summary.damaged_bytes} of {summary.file_bytes} bytes are damaged or cut off"
        print_warnings(path, [f"{text}; {summary.events} complete messages were read"])
    return log


def load_settings(values: dict[str, Any]) -> Settings:
    """Return settings with these values; raises ``typer.BadParameter`` if one or an environment variable is invalid."""
    from gateway.runtime.settings import SettingsError, load

    try:
        return load(values)
    except SettingsError as error:
        raise typer.BadParameter(str(error)) from None


def print_warnings(path: Path, sentences: Iterable[str]) -> None:
    """Print sentences about what of a log is not shown."""
    for sentence in sentences:
        print_note(f"{path}: {sentence}")
