"""``scenegate dataset``: commands for datasets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Commands for datasets written by `scenegate render`.", no_args_is_help=True)
MAX_SHOWN = 100
"""Maximum number of problems and of notes that are printed; the others are counted."""


@app.callback()
def _common() -> None:
    pass


@app.command()
def schema() -> None:
    """Print the JSON schema of scenario files, for editors."""
    from gateway.datasets.scenario.file import schema_text

    typer.echo(schema_text(), nl=False)


@app.command()
def check(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", exists=True, file_okay=False, help="Dataset folder.")],
    threads: Annotated[int, typer.Option(min=0, help="Number of threads; 0: one per core.")] = 0,
) -> None:
    """Verify a dataset: manifest, hashes, sizes and types of the images, cameras, labels."""
    from gateway.datasets.check import check_dataset
    from gateway.runtime.kernels.cache import configure
    from gateway.runtime.scheduling import usable_cpus
    from scenegate.cli.progress_bar import progress_bar

    configure()
    with progress_bar("Checking", "samples", 1) as bar:
        report = check_dataset(
            folder, threads or usable_cpus(), lambda done, total: bar.update(done, done, total=total)
        )
    for note in report.notes[:MAX_SHOWN]:
        typer.echo(f"note: {note}", err=True)
    for problem in report.problems[:MAX_SHOWN]:
        typer.echo(f"scenegate: {problem}", err=True)
    for what, lines in (("notes", report.notes), ("problems", report.problems)):
        if len(lines) > MAX_SHOWN:
            typer.echo(f"... and {len(lines) - MAX_SHOWN} more {what}", err=True)
    typer.echo(
        f"{folder}: {report.samples} samples of {report.scenes} scenes, {report.images} images, "
        f"{report.image_bytes / 1e6:.1f} MB, {len(report.problems)} problems"
    )
    if report.problems:
        raise typer.Exit(1)
