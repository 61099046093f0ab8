"""Logs: one line an event, for people in a terminal and as JSON objects elsewhere, with the request's id."""

from __future__ import annotations

import contextlib
import logging
import sys
from typing import Any, Literal

import structlog
from structlog.typing import Processor

from gateway.runtime.recent_logs import recent_logs

Format = Literal["auto", "human", "json"]

_QUIET = {
    "asyncio": logging.WARNING,
    "numba": logging.WARNING,
    "PIL": logging.WARNING,
    "trimesh": logging.ERROR,
}
"""Libraries that tell more than anybody wants at debug level."""


class _Lines:
    """What structlog hands finished lines to, in place of a logger of the standard library, whose name and level count:
    they go where its handler writes. By a record each, which is made, filtered and formatted once more, a line takes
    twice as long, and each request has one."""

    __slots__ = ("_handler", "_logger", "getEffectiveLevel", "name")

    def __init__(self, handler: logging.StreamHandler[Any], logger: logging.Logger) -> None:
        self._handler = handler
        self._logger = logger
        self.getEffectiveLevel = logger.getEffectiveLevel
        self.name = logger.name

    @property
    def disabled(self) -> bool:
        """As of loggers."""
        return self._logger.disabled

    def info(self, line: str) -> None:
        """Writes it. Nobody may be there to read."""
        with contextlib.suppress(OSError, ValueError):
            self._handler.acquire()
            try:
                self._handler.stream.write(line + "\n")
                self._handler.flush()
            finally:
                self._handler.release()

    debug = warning = warn = error = critical = fatal = exception = info


class _Factory:
    """Makes them, one for each name."""

    def __init__(self, handler: logging.StreamHandler[Any]) -> None:
        self._handler = handler
        self._loggers = structlog.stdlib.LoggerFactory(ignore_frame_names=[__name__])
        self._named: dict[str, _Lines] = {}

    def __call__(self, *args: str) -> _Lines:
        found = self._named.get(args[0]) if args else None
        if found is None:
            found = _Lines(self._handler, self._loggers(*args))
            self._named[found.name] = found
        return found


def configure(log_format: Format = "auto", level: str = "info", *, uvicorn_starts: bool = False) -> None:
    """Sends what structlog and the standard library log to stderr in one format.

    Args:
        log_format: ``auto`` is ``human`` where stderr is a terminal, else ``json``.
        level: the least that is logged: debug, info, warning, error.
        uvicorn_starts: the process is ``uvicorn gateway.app:app``, and uvicorn may log address, start and end as its
            --log-level says; else it logs warnings only.
    """
    human = log_format == "human" or (log_format == "auto" and sys.stderr.isatty())
    shared: list[Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.stdlib.PositionalArgumentsFormatter(),
        structlog.processors.TimeStamper(fmt="%H:%M:%S" if human else "iso", utc=not human),
        structlog.processors.StackInfoRenderer(),
    ]
    last: list[Processor]
    if human:
        last = [structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty(), pad_event_to=0)]
    else:
        last = [structlog.processors.format_exc_info, structlog.processors.JSONRenderer()]
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(
        structlog.stdlib.ProcessorFormatter(
            foreign_pre_chain=shared,
            processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, *last],
        )
    )
    root = logging.getLogger()
    root.handlers[:] = [handler]
    root.setLevel(level.upper())
    for name, least in _QUIET.items():
        logging.getLogger(name).setLevel(least)
    uvicorn = logging.getLogger("uvicorn.error")
    uvicorn.setLevel(max(uvicorn.level, root.level) if uvicorn_starts else logging.WARNING)
    # The command uvicorn gives its loggers handlers; their lines go to the root's handler instead. Its access
    # log is switched off as --no-access-log does: gateway.server.middleware writes a line with the request's id.
    for name, propagate in (("uvicorn", True), ("uvicorn.error", True), ("uvicorn.access", False)):
        logger = logging.getLogger(name)
        logger.handlers[:], logger.propagate = [], propagate
    structlog.configure(
        # What nobody wants is not made ready first.
        processors=[structlog.stdlib.filter_by_level, *shared, recent_logs, *last],
        logger_factory=_Factory(handler),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=False,
    )
