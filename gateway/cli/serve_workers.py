"""``scenegate serve --workers``: several processes on one port, under a supervisor."""

import os
import shutil
import signal
import socket
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Final

import structlog

from gateway.runtime.file_lock import Lock, try_lock
from gateway.runtime.logs import log_setup
from gateway.runtime.settings import Settings, SettingsError
from gateway.runtime.workers import process_tuning
from gateway.runtime.workers.supervisor import START_FAILED, TERMINAL_SIGNALS, Supervisor
from gateway.runtime.workers.worker_reports import WorkerReports

RETRY_SECONDS: Final = 5.0
"""Delay before a process that cannot start ends, so that it is not restarted at once."""
_PREFIX: Final = "scenegate-workers-"
"""Start of the names of the folders for reports."""
_OLD_SECONDS: Final = 60.0
"""Age of a folder that may be removed. Processes write their reports twice a second."""


def serve_workers(settings: Settings, listener: socket.socket) -> int:
    """Supervise processes, which all accept connections from ``listener``, until a signal; return the exit code."""
    log = structlog.get_logger("gateway")
    process_tuning.freeze_gc()
    with ExitStack() as stack:
        try:
            folder = stack.enter_context(reports_folder())
        except OSError as error:
            log.error(f"--workers needs a temporary folder, which TMPDIR names: {error.strerror}.")
            return 1
        supervisor = Supervisor(
            partial(run_worker, settings, folder, listener),
            settings.processes,
            unresponsive_seconds=settings.unresponsive_seconds,
            stop_seconds=settings.shutdown_seconds,
        )
        works = supervisor.run()
    log.info("Scenegate has stopped")
    return 0 if works else 1


def run_worker(settings: Settings, folder: Path, listener: socket.socket, connection: Connection) -> None:
    """Serve in one process. ``folder``: that of the processes' reports. ``connection``: that to the supervisor."""
    process_tuning.pause_gc()
    process_tuning.end_with_parent()
    for number in TERMINAL_SIGNALS:  # the supervisor handles them, and sends SIGTERM; the server also handles SIGINT
        signal.signal(number, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, TERMINAL_SIGNALS)
    log_setup.configure(settings.log_format, settings.log_level, worker=os.getpid())
    from gateway.app import create_app
    from gateway.cli.serve_app import serve_app

    create = partial(create_app, settings, reports=WorkerReports(folder, settings.processes), supervisor=connection)
    try:
        code = serve_app(create, listener)
    except SettingsError as error:  # a file has changed since the supervisor started
        structlog.get_logger("gateway").error(f"This process cannot start: {error}")
        time.sleep(RETRY_SECONDS)
        sys.exit(1)
    sys.exit(START_FAILED if code else 0)


@contextmanager
def reports_folder() -> Iterator[Path]:
    """Yield a new, locked temporary folder; remove first what killed supervisors have left. Raises OSError."""
    for folder in Path(tempfile.gettempdir()).glob(f"{_PREFIX}*"):
        with suppress(OSError):  # it belongs to another user
            if time.time() - folder.lstat().st_mtime > _OLD_SECONDS:
                with _locked(folder) as lock:
                    if lock is Lock.HELD:
                        shutil.rmtree(folder)
    with (
        tempfile.TemporaryDirectory(prefix=_PREFIX, ignore_cleanup_errors=True) as folder_name,
        _locked(Path(folder_name)),
    ):
        yield Path(folder_name)


@contextmanager
def _locked(folder: Path) -> Iterator[Lock]:
    """Try to lock a folder, and yield the result. The system releases the lock when the process ends."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        yield try_lock(descriptor)
    finally:
        os.close(descriptor)
