"""Spans of OpenTelemetry. Interfaces open them with ``span``; without ``use`` that does nothing.

The current span is a context variable. ``WorkerPool`` and asyncio's tasks carry it along.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Final, TypeVar

from opentelemetry import trace
from opentelemetry.trace import SpanKind, Tracer, TracerProvider
from opentelemetry.util.types import AttributeValue

T = TypeVar("T")

_NOTHING: Final = nullcontext()
_provider: TracerProvider | None = None
_tracer: Tracer | None = None


def use(provider: TracerProvider | None) -> None:
    """Create all further spans of this process with a provider; None: create none."""
    global _provider, _tracer
    _provider = provider
    _tracer = provider.get_tracer("scenegate") if provider is not None else None


def provider() -> TracerProvider | None:
    """Return the provider of ``use``."""
    return _provider


def span(
    name: str, attributes: Mapping[str, AttributeValue] | None = None, kind: SpanKind = SpanKind.INTERNAL
) -> AbstractContextManager[object]:
    """Return a context manager that is a span below the current one.

    An error that leaves it becomes the status of the span, without its traceback, which may hold data of clients.

    Args:
        name: one of few names; what differs between calls is an attribute.
        attributes: names as in OpenTelemetry's semantic conventions.
    """
    if _tracer is None:
        return _NOTHING
    return _tracer.start_as_current_span(name, kind=kind, attributes=attributes, record_exception=False)


def lcm_message_span(channel: str, size: int) -> AbstractContextManager[object]:
    """Return the span of a received LCM message of ``size`` bytes, from reading it to showing it."""
    if _tracer is None:
        return _NOTHING
    attributes: dict[str, AttributeValue] = {
        "messaging.system": "lcm",
        "messaging.operation.type": "process",
        "messaging.destination.name": channel,
        "messaging.message.body.size": size,
    }
    return span("process LCM message", attributes, SpanKind.CONSUMER)


def after_queue(function: Callable[[], T]) -> Callable[[], T]:
    """Return a function that ends a span ``queue``, which starts now, and calls ``function``.

    There is no such span where no span is current: it would be alone.
    """
    if _tracer is None or not trace.get_current_span().get_span_context().is_valid:
        return function
    queue = _tracer.start_span("queue")

    def run() -> T:
        queue.end()
        return function()

    return run
