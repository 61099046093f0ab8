"""``scenegate view``: shows a log in the browser."""

import sys
from functools import partial
from pathlib import Path
from typing import Annotated, Final

import typer

from gateway.cli.log_files import MeshRoot, load_settings, open_log_file, print_warnings
from scenegate.cli.output import print_note

HOST: Final = "127.0.0.1"
"""Loopback: the log may name mesh files of this machine."""


def view(
    log: Annotated[Path, typer.Argument(metavar="LOG", exists=True, dir_okay=False, help="LCM log.")],
    http_port: Annotated[int, typer.Option(min=0, max=65535, help="Port on 127.0.0.1; 0: any.")] = 8020,
    mesh_root: MeshRoot = "auto",
    open_page: Annotated[bool, typer.Option("--open", help="Open the page in the default browser.")] = False,
) -> None:
    """Show an LCM log in the browser, at any time of it: tree viewer clients, Drake's simulations."""
    from gateway.app import create_app
    from gateway.cli.serve_app import serve_app
    from gateway.replay.log_service import LogService
    from gateway.runtime.kernels.parts import ensure_compiled
    from gateway.runtime.logs import log_setup
    from gateway.runtime.workers import process_tuning
    from scenegate.cli.progress_bar import progress_bar

    # Page and scene, without LCM, state file, demo or TLS, whatever the environment says.
    fixed = {"only": "view,scene", "host": HOST, "workers": 1, "state": None, "demo": False, "history_seconds": 0.0}
    without_tls = {"http_certificate": None, "http_key": None}
    settings = load_settings({**fixed, **without_tls, "http_port": http_port, "mesh_root": mesh_root})
    log_setup.configure("human" if sys.stderr.isatty() else settings.log_format, "warning")
    try:
        listener = process_tuning.listen(HOST, http_port)
    except OSError as error:
        raise OSError(f"--http-port {http_port}: {process_tuning.listen_error(error, HOST, http_port)}") from None
    with listener:
        ensure_compiled(show=True)
        timeline = open_log_file(log, mesh_root)
        with progress_bar("Indexing", "% of the log", 1.0) as bar:

            def on_progress(progress: float) -> None:
                if progress < 1.0:
                    bar.update(progress, int(100 * progress))
                else:
                    bar.end()

            create = partial(create_app, settings, log=LogService(timeline, on_progress))
            url = f"http://{HOST}:{listener.getsockname()[1]}/view"
            print_note(f"{log} is at {url} until Ctrl+C.")
            if open_page:
                typer.launch(url)
            code = serve_app(create, listener)
    print_warnings(log, timeline.incomplete.listed())
    raise typer.Exit(code)
