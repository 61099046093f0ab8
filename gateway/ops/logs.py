"""Logs: one line an event, for people in a terminal and as JSON objects elsewhere, with the request's id."""

from __future__ import annotations

import logging
import sys
from typing import Literal

import structlog
from structlog.typing import Processor

Format = Literal["auto", "human", "json"]

_QUIET = {
    "asyncio": logging.WARNING,
    "uvicorn.error": logging.WARNING,
    "numba": logging.WARNING,
    "PIL": logging.WARNING,
    "trimesh": logging.ERROR,
}
"""Libraries that tell more than anybody wants at debug level."""


def configure(log_format: Format = "auto", level: str = "info") -> None:
    """Sends what structlog and the standard library log to stderr in one format.

    Args:
        log_format: ``auto`` is ``human`` where stderr is a terminal, else ``json``.
        level: the least that is logged: debug, info, warning, error.
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
    for name in ("uvicorn", "uvicorn.error"):  # uvicorn's own handlers would print a second time
        logger = logging.getLogger(name)
        logger.handlers[:], logger.propagate = [], True
    structlog.configure(
        # What nobody wants is not made ready first.
        processors=[structlog.stdlib.filter_by_level, *shared, structlog.stdlib.ProcessorFormatter.wrap_for_formatter],
        logger_factory=structlog.stdlib.LoggerFactory(),
        wrapper_class=structlog.stdlib.BoundLogger,
        cache_logger_on_first_use=False,
    )
