"""The command ``scenegate``. Commands import lazily, and every expected error is one sentence without a traceback."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from gateway import __version__
from gateway.cli import dataset
from gateway.cli.lcm_log import play, record
from gateway.cli.publish import publish
from gateway.cli.render import render
from gateway.cli.serve import add_serve
from gateway.client.command import stream

app = typer.Typer(
    name="scenegate",
    help="Drake's glTF render server, an rc_visard stereo camera and Director's tree viewer, on one scene.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"scenegate {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


def warmup() -> None:
    """Compile the rendering kernels into the cache, so that the next start is fast."""
    from gateway.runtime.kernels.cache import configure
    from gateway.runtime.kernels.loading import ensure_compiled
    from renderers.compiler import cache_folder

    folder = configure()
    ensure_compiled(show=True)
    typer.echo(f"The {cache_folder.count()} rendering kernels are in {folder}.")


def doctor() -> None:
    """Find what does not work, what that means and what to do: libraries, ports, multicast, limits, kernel cache."""
    from gateway.cli.doctor import print_findings

    if not print_findings():
        raise typer.Exit(1)


add_serve(app)
for command in (render, stream, publish, record, play, doctor, warmup):
    app.command()(command)
app.add_typer(dataset.app, name="dataset")


def run() -> None:
    """Run the command. Every expected error is one sentence without a traceback."""
    try:
        app()
    except (OSError, ValueError, RuntimeError, ImportError) as error:
        message = str(error)
        if isinstance(error, OSError) and error.filename is not None:
            message = f"{error.filename}: {error.strerror}"
        typer.echo(f"scenegate: {message}", err=True)
        sys.exit(1)
