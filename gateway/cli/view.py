"""``scenegate view``: shows a log in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from gateway.cli.log_files import MeshRoot


def view(
    log: Annotated[Path, typer.Argument(metavar="LOG", exists=True, dir_okay=False, help="LCM log.")],
    http_port: Annotated[int, typer.Option(min=0, max=65535, help="Port on 127.0.0.1; 0: any.")] = 8020,
    mesh_root: MeshRoot = "auto",
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in the default browser.")] = False,
) -> None:
    """Show an LCM log in the browser, at any time of it: tree viewer clients, Drake's simulations."""
    from gateway.cli.view_log import view_log
    from gateway.settings import SettingsError

    def on_url(url: str) -> None:
        typer.echo(f"{log} is at {url} until Ctrl+C.", err=True)
        if open_page:
            typer.launch(url)

    try:
        code = view_log(log, http_port, mesh_root, on_url)
    except SettingsError as error:
        raise typer.BadParameter(str(error)) from None
    raise typer.Exit(code)
