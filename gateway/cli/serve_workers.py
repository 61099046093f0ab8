"""``scenegate serve --workers``: several processes on one port, under uvicorn's supervisor."""

from __future__ import annotations

import os
import signal
import socket
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import structlog

from gateway.runtime import logs, process_tuning
from gateway.runtime.worker_reports import WorkerReports
from gateway.settings import Settings, SettingsError

if TYPE_CHECKING:
    from fastapi import FastAPI
    from uvicorn import Config
    from uvicorn.supervisors import Multiprocess

RETRY_SECONDS: Final = 5.0
"""Time after which a process that cannot start ends, and the supervisor tries again."""


def serve_workers(settings: Settings, listener: socket.socket, tls: tuple[Path, Path] | None) -> int:
    """Serve until a signal, and return the exit code. The supervisor replaces processes that end.

    Args:
        settings: settings of each process.
        listener: listening socket, from which all processes accept connections.
        tls: PEM files of certificate and key; None: plain HTTP.
    """
    from uvicorn.config import STARTUP_FAILURE
    from uvicorn.supervisors import Multiprocess

    log = structlog.get_logger("gateway")
    process_tuning.freeze_gc()
    try:
        temporary = tempfile.TemporaryDirectory(prefix="scenegate-workers-")
    except OSError as error:
        log.error(f"--workers needs a temporary folder, which TMPDIR names: {error.strerror}.")
        return 1
    with temporary as folder:
        supervisor = Multiprocess(_config(settings, Path(folder), tls), [listener])
        _notice_ended_processes(supervisor)
        supervisor.run()
    log.info("Scenegate has stopped")
    return 1 if any(process.exitcode == STARTUP_FAILURE for process in supervisor.processes) else 0


def _notice_ended_processes(supervisor: Multiprocess) -> None:
    """Let the supervisor replace a process at once that ends while the supervisor waits for its response.

    uvicorn waits for ``http_server.UNRESPONSIVE_SECONDS``, and handles no signal meanwhile. It does not notice the end
    of the process, because it keeps the process's end of their pipe open. Closing this end wakes it up.
    """

    def close_pipes(*_: object) -> None:
        for process in supervisor.processes:
            if process.pid is not None and _has_ended(process.pid):
                process.child_conn.close()

    signal.signal(signal.SIGCHLD, close_pipes)


def _has_ended(pid: int) -> bool:
    """Return whether a child process has ended. Its exit code stays for the supervisor."""
    try:
        return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
    except ChildProcessError:
        return True


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

    try:
        app = create_app(settings, reports=WorkerReports(folder, settings.workers))
    except SettingsError as error:  # a file has changed since the supervisor started
        structlog.get_logger("gateway").error(f"This process cannot start: {error}")
        time.sleep(RETRY_SECONDS)
        raise SystemExit(1) from None
    app.state.context.on_started = process_tuning.freeze_gc
    return app
