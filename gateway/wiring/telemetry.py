"""OpenTelemetry: FastAPI's span of each request, and ours below it, for the collector that the environment names."""

from __future__ import annotations

import os
from collections.abc import Mapping, MutableMapping
from threading import Thread
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import parse_qs

import structlog
from fastapi.telemetry import TelemetryConfig
from opentelemetry import trace

from gateway import __version__
from gateway.runtime.http.access import TOKEN_PARAMETER
from gateway.runtime.http.health import MONITORING_PATHS
from gateway.runtime.logs import tracing

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider

_log = structlog.get_logger("gateway.telemetry")

ENDPOINTS: Final = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")
"""Environment variables with the collector's address. One of them switches spans on."""
EXPORT_SECONDS: Final = 2.0
"""Time limit for sending some hundred spans, with retries. Spans that a collector does not take by then are lost."""
CLOSE_SECONDS: Final = 1.0
"""Time limit for sending the last spans at shutdown."""
NO_TELEMETRY: Final[TelemetryConfig] = {"tracing": False, "metrics": False, "logs": False, "auto_configure": False}
"""Switches off FastAPI's telemetry."""


def start(environ: Mapping[str, str] = os.environ) -> TracerProvider | None:
    """Let ``tracing.span`` create spans if they have a destination; return our provider, to be closed, or None."""
    given = trace.get_tracer_provider()
    if not isinstance(given, trace.ProxyTracerProvider):
        tracing.use(given)
        return None
    provider = _provider(environ) if _has_collector(environ) else None
    tracing.use(provider)
    return provider


def config() -> TelemetryConfig:
    """Return FastAPI's part. Metrics are at ``/metrics`` and the log is on stderr: neither is sent."""
    if tracing.provider() is None:
        return NO_TELEMETRY
    return {
        **NO_TELEMETRY,
        "tracing": True,
        "operation_spans": False,  # for the route's function and its arguments; ours say more
        "tracer_provider": tracing.provider(),
        "exclude": _is_excluded,
    }


def close(provider: TracerProvider) -> None:
    """Send the last spans, for at most ``CLOSE_SECONDS``."""
    thread = Thread(target=provider.shutdown, name="telemetry", daemon=True)  # its own time limit is 30 s
    thread.start()
    thread.join(CLOSE_SECONDS)


def _has_collector(environ: Mapping[str, str]) -> bool:
    """Return True if the environment names a collector of spans and does not switch spans off."""
    if environ.get("OTEL_SDK_DISABLED", "").lower() == "true" or environ.get("OTEL_TRACES_EXPORTER") == "none":
        return False
    return any(environ.get(name) for name in ENDPOINTS)


def _provider(environ: Mapping[str, str]) -> TracerProvider | None:
    """Return a provider that sends spans, named ``scenegate`` unless the environment names it; None without the SDK."""
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import OTELResourceDetector, Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError:
        named = next(name for name in ENDPOINTS if environ.get(name))
        _log.warning(f"{named} is set, but spans need an extra: pip install 'scenegate[telemetry]'")
        return None
    ours = Resource.create({"service.name": "scenegate", "service.version": __version__})
    provider = TracerProvider(resource=ours.merge(OTELResourceDetector().detect()), shutdown_on_exit=False)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter(timeout=EXPORT_SECONDS)))
    return provider


def _is_excluded(scope: MutableMapping[str, Any]) -> bool:
    """Return True for monitoring, and for requests with a token in their address, which spans would show."""
    query = scope.get("query_string", b"")
    return scope["path"] in MONITORING_PATHS or TOKEN_PARAMETER in parse_qs(query.decode("latin-1"))
