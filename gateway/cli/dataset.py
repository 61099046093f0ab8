"""``scenegate dataset``: commands for datasets."""

from pathlib import Path
from typing import Annotated, Final, Literal

import typer

from scenegate.cli.output import print_line, print_note

app = typer.Typer(help="Commands for datasets written by `scenegate render`, and for scenarios.", no_args_is_help=True)
MAX_SHOWN: Final = 100
"""Maximum number of problems and of notes that are printed; the others are counted."""
Folder = Annotated[Path, typer.Argument(metavar="FOLDER", exists=True, file_okay=False, help="Dataset folder.")]
ExportFormat = Literal["bop", "coco", "webdataset", "hdf5"]


@app.command()
def schema() -> None:
    """Print the JSON schema of scenario files, for editors."""
    from gateway.datasets.scenario.file import schema_text

    typer.echo(schema_text(), nl=False)


@app.command()
def track(
    log: Annotated[Path, typer.Argument(metavar="LOG", exists=True, dir_okay=False, help="LCM log.")],
    node: Annotated[str, typer.Argument(metavar="PATH", help='Path of the node, such as \'["robot", "base"]\'.')],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="CSV", help="File to write.")],
) -> None:
    """Write the poses of a node in an LCM log as a track for scenarios (pose_track)."""
    from gateway.datasets.log_track import track_csv_of_log
    from gateway.runtime.kernels.parts import ensure_compiled
    from gateway.scene.draw.mount import parse_mount_path

    path = parse_mount_path(node)
    ensure_compiled(show=True)
    table = track_csv_of_log(log, path)
    out.write_text(table, "utf-8")
    print_note(f"{out}: {table.count(chr(10)) - 1} poses")


@app.command()
def check(
    folder: Folder, threads: Annotated[int, typer.Option(min=0, help="Number of threads; 0: one per core.")] = 0
) -> None:
    """Verify a dataset: manifest, hashes and sizes of the images, models."""
    from gateway.datasets.check import check_dataset
    from gateway.runtime.workers.scheduling import usable_cpus
    from scenegate.cli.progress_bar import progress_bar

    with progress_bar("Checking", "samples") as bar:  # the total is known at the first report
        report = check_dataset(
            folder, threads or usable_cpus(), lambda done, total: bar.update(done, count=done, total=total)
        )
    for start, what, lines in (("note", "notes", report.notes), ("scenegate", "problems", report.problems)):
        for line in lines[:MAX_SHOWN]:
            print_note(f"{start}: {line}")
        if len(lines) > MAX_SHOWN:
            print_note(f"... and {len(lines) - MAX_SHOWN} more {what}")
    print_line(
        f"{folder}: {report.samples} samples of {report.scenes} scenes, {report.images} images, "
        f"{report.image_bytes / 1e6:.1f} MB, {len(report.problems)} problems"
    )
    if report.problems:
        raise typer.Exit(1)


@app.command()
def export(
    folder: Folder,
    destination: Annotated[Path, typer.Argument(metavar="DEST", help="Folder to write, empty or missing.")],
    format_name: Annotated[ExportFormat, typer.Option("--format", help="Format to write.")],
) -> None:
    """Write a dataset in another format: BOP, COCO, WebDataset or HDF5."""
    export_dataset(folder, destination, format_name)


def export_dataset(folder: Path, destination: Path, format_name: ExportFormat, *, replace: bool = False) -> None:
    """Write a dataset in another format and show the progress; arguments and errors of ``formats.export``."""
    from scenegate.cli.progress_bar import progress_bar
    from scenegate.datasets import Dataset
    from scenegate.datasets.formats import export as write

    dataset = Dataset(folder)
    with progress_bar("Exporting", f"of {len(dataset)} samples", len(dataset)) as bar:
        is_new = write(dataset, destination, format_name, lambda done: bar.update(done, done), replace=replace)
    earlier = "" if is_new else ", exported before"
    print_note(f"{destination}: {len(dataset)} samples as {format_name}{earlier}")


@app.command()
def show(
    folder: Folder,
    out: Annotated[
        Path | None, typer.Option("-o", "--out", metavar="FILE.html", help="File to write. Default: FOLDER.html.")
    ] = None,
    samples: Annotated[int, typer.Option(min=1, max=2000, help="Maximum number of samples, chosen at random.")] = 100,
) -> None:
    """Write a contact sheet: samples with masks and boxes, by class, in one HTML file for a browser."""
    from gateway.datasets.contact_sheet import contact_sheet
    from gateway.datasets.files import write_atomically
    from scenegate.datasets import Dataset

    path = out or folder.resolve().with_name(f"{folder.resolve().name}.html")
    if path.suffix.lower() != ".html":
        raise ValueError(f"{path}: the file must end with .html")
    page = contact_sheet(Dataset(folder), samples).encode()
    write_atomically(path, page)
    print_note(f"{path}: {len(page) / 1e6:.1f} MB")
