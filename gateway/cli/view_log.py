"""Serves the page of a log to browsers on this machine, for ``scenegate view``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gateway.app import create_app
from gateway.cli.log_files import open_log_file, print_warnings
from gateway.cli.serve_app import serve_app
from gateway.runtime import logs, process_tuning
from gateway.runtime.kernels.loading import ensure_compiled
from gateway.settings import Settings, load
from gateway.wiring.log import LogService
from scenegate.cli.progress_bar import progress_bar

HOST: Final = "127.0.0.1"
"""Loopback: the log may name mesh files of this machine."""


def view_log(path: Path, http_port: int, mesh_root: str, on_url: Callable[[str], None]) -> int:
    """Serve until SIGINT or SIGTERM; return the exit code.

    Args:
        path: LCM log.
        http_port: 0: any.
        mesh_root: as the setting.
        on_url: called with the URL of the page when requests are accepted.

    Raises:
        SettingsError: an option or an environment variable is invalid.
        LogError: the file is not an LCM log, or none of its messages can be shown.
        OSError: the log cannot be read, or the port cannot be used.
    """
    settings = settings_for(http_port, mesh_root)
    logs.configure("human" if sys.stderr.isatty() else settings.log_format, "warning")
    try:
        listener = process_tuning.listen(HOST, http_port)
    except OSError as error:
        raise OSError(f"--http-port {http_port}: {process_tuning.listen_error(error, HOST, http_port)}") from None
    with listener:
        ensure_compiled(show=True)
        timeline = open_log_file(path, mesh_root)
        with progress_bar("Indexing", "% of the log", 1.0) as bar:

            def on_progress(progress: float) -> None:
                if progress < 1.0:
                    bar.update(progress, int(100 * progress))
                else:
                    bar.end()

            app = create_app(settings, log=LogService(timeline, on_progress))
            on_url(f"http://{HOST}:{listener.getsockname()[1]}/view")
            code = serve_app(app, listener, None)
    print_warnings(path, timeline.incomplete.listed())
    return code


def settings_for(http_port: int, mesh_root: str) -> Settings:
    """Return the settings of a server that shows a log: page and scene, without LCM, state file or demo."""
    fixed = {"only": "view,scene", "host": HOST, "workers": 1, "state": None, "demo": False, "history_seconds": 0.0}
    without_tls = {"http_certificate": None, "http_key": None}
    return load({**fixed, **without_tls, "http_port": http_port, "mesh_root": mesh_root})
