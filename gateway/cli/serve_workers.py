"""``scenegate serve --workers``: several processes on one port, under uvicorn's supervisor."""

from __future__ import annotations

import os
import socket
import tempfile
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import structlog

from gateway.runtime import logs, process_tuning
from gateway.runtime.worker_reports import WorkerReports
from gateway.settings import Settings

if TYPE_CHECKING:
    from fastapi import FastAPI
    from uvicorn import Config


def serve_workers(settings: Settings, listener: socket.socket, tls: tuple[Path, Path] | None) -> int:
    """Serve until a signal, and return the exit code. The supervisor replaces processes that end.

    Args:
        settings: settings of each process.
        listener: listening socket, from which all processes accept connections.
        tls: PEM files of certificate and key; None: plain HTTP.
    """
    from uvicorn.config import STARTUP_FAILURE
    from uvicorn.supervisors import Multiprocess

    process_tuning.freeze_gc()
    with tempfile.TemporaryDirectory(prefix="scenegate-workers-") as folder:
        supervisor = Multiprocess(_config(settings, Path(folder), tls), [listener])
        supervisor.run()
    structlog.get_logger("gateway").info("Scenegate has stopped")
    return 1 if any(process.exitcode == STARTUP_FAILURE for process in supervisor.processes) else 0


def _config(settings: Settings, folder: Path, tls: tuple[Path, Path] | None) -> Config:
    from gateway.server.http_server import server_config

    app = partial(create_worker, settings, folder)
    return server_config(app, settings.shutdown_seconds, lifespan=True, tls=tls, workers=settings.workers)


def create_worker(settings: Settings, folder: Path) -> FastAPI:
    """Create the application. uvicorn calls this in each new process.

    Args:
        settings: settings of each process.
        folder: shared folder of the processes' reports.
    """
    process_tuning.pause_gc()
    process_tuning.end_with_parent()
    logs.configure(settings.log_format, settings.log_level, worker=os.getpid())
    from gateway.app import create_app

    app = create_app(settings, reports=WorkerReports(folder, settings.workers))
    app.state.context.on_started = process_tuning.freeze_gc
    return app
