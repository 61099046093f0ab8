"""Spans of OpenTelemetry. Interfaces open them with ``span``; without ``use`` that does nothing.

The current span is a context variable. ``WorkerPool`` and asyncio's tasks carry it along.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import partial
from typing import Final

from opentelemetry.trace import NoOpTracer, SpanKind, Tracer, TracerProvider

_NOTHING: Final = nullcontext()
_provider: TracerProvider | None = None

tracer: Tracer
"""Creates the spans of this process."""
span: Callable[..., AbstractContextManager[object]]
"""``Tracer.start_as_current_span``: returns a context manager that is a span below the current one.

An error that leaves it becomes the status of the span, without its traceback, which may hold data of clients. Names are
few; what differs between calls is an attribute. Without a provider it does nothing: OpenTelemetry's own way to do
nothing takes 30 calls.
"""


def _no_span(name: str, **_: object) -> AbstractContextManager[object]:
    return _NOTHING


def use(provider: TracerProvider | None) -> None:
    """Create all further spans of this process with a provider; None: create none."""
    global _provider, tracer, span
    _provider = provider
    tracer = provider.get_tracer("scenegate") if provider is not None else NoOpTracer()
    span = partial(tracer.start_as_current_span, record_exception=False) if provider is not None else _no_span


def provider() -> TracerProvider | None:
    """Return the provider of ``use``."""
    return _provider


def lcm_message_span(channel: str, size: int) -> AbstractContextManager[object]:
    """Return the span of a received LCM message of ``size`` bytes, from reading it to showing it."""
    if _provider is None:  # a message takes 30 µs
        return _NOTHING
    attributes = {
        "messaging.system": "lcm",
        "messaging.operation.type": "process",
        "messaging.destination.name": channel,
        "messaging.message.body.size": size,
    }
    return span("process LCM message", kind=SpanKind.CONSUMER, attributes=attributes)


use(None)
