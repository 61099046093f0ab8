"""Log configuration: one line per event with the request's id, readable in a terminal and JSON elsewhere."""

import logging
import os
import sys
import traceback
from typing import Literal, TextIO

import structlog
from structlog.typing import EventDict, ExcInfo, Processor

from gateway.runtime.logs.recent_logs import stereo_log
from scenegate.printable import printable

Format = Literal["auto", "human", "json"]

_LIBRARY_LEVELS = {"asyncio": logging.WARNING, "numba": logging.WARNING, "PIL": logging.WARNING}
"""Minimum levels of libraries that are verbose at debug level."""


def configure(
    log_format: Format = "auto", level: str = "info", *, log_uvicorn: bool = False, worker: int | None = None
) -> None:
    """Send log entries of structlog and of the standard library to stderr in one format, from a level on.

    ``log_uvicorn``: also uvicorn's entries, such as its address, from the level of its --log-level on, not only its
    warnings. ``worker``: process id to add to each line (``--workers``).
    """

    # The core of gRPC writes lines of its own to stderr, such as failed TLS handshakes; errors of calls tell enough.
    os.environ.setdefault("GRPC_VERBOSITY", "NONE")

    def add_worker(_logger: object, _method: str, event: EventDict) -> EventDict:
        return {**event, "worker": worker}

    human = log_format == "human" or (log_format == "auto" and sys.stderr.isatty())
    shared: list[Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.stdlib.PositionalArgumentsFormatter(),
        structlog.processors.TimeStamper(fmt="%H:%M:%S" if human else "iso", utc=not human),
        structlog.processors.StackInfoRenderer(),
        *([add_worker] if worker is not None else []),
    ]
    last: list[Processor]
    if human:
        colors = sys.stderr.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
        renderer = structlog.dev.ConsoleRenderer(colors=colors, pad_event_to=0, exception_formatter=_write_traceback)
        last = [_escape_text, renderer]
    else:
        last = [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()]
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared, processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *last]
        )
    )
    # Our lines name no thread, process or place in the code; finding them takes a fifth of the time for a line.
    logging.logThreads = logging.logMultiprocessing = logging.logProcesses = False
    logging._srcfile = None  # noqa: SLF001 - as the documentation of logging recommends
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    logging.getLogger("stereo").handlers[:] = [stereo_log]
    for name, minimum in _LIBRARY_LEVELS.items():
        logging.getLogger(name).setLevel(minimum)
    uvicorn = logging.getLogger("uvicorn.error")
    uvicorn.setLevel(max(uvicorn.level, root.level) if log_uvicorn else logging.WARNING)
    # The uvicorn command adds handlers to its loggers; the root's handler replaces them. The access log is off, as with
    # --no-access-log: gateway.runtime.http.edge logs a line with the request's id.
    for name, propagate in (("uvicorn", True), ("uvicorn.error", True), ("uvicorn.access", False)):
        logger = logging.getLogger(name)
        logger.handlers[:], logger.propagate = [], propagate
    structlog.configure(
        processors=[structlog.stdlib.filter_by_level, *shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=False,
    )


def _escape_text(_logger: object, _method: str, event: EventDict) -> EventDict:
    """Escape text of clients and files, which could steer a terminal or begin a line."""
    return {key: printable(value) if isinstance(value, str) else value for key, value in event.items()}


def _write_traceback(out: TextIO, exc_info: ExcInfo) -> None:
    """Write a traceback, indented so that its text cannot look like a log line, and without local variables."""
    lines = "".join(traceback.format_exception(*exc_info)).split("\n")
    out.write("".join(f"\n  {printable(line)}" for line in lines))
