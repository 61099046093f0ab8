"""``/healthz`` (liveness), ``/readyz`` (readiness), ``/metrics`` (Prometheus)."""

import asyncio
import json
from collections.abc import Callable
from typing import Any, Final

from fastapi import APIRouter, Request, Response

from gateway.runtime.http.access import AUTHORIZED
from gateway.runtime.http.openapi import Responses, json_example
from gateway.runtime.logs.metrics_registry import CONTENT_TYPE, Metrics
from gateway.runtime.service_registry import ServiceRegistry
from gateway.runtime.workers.worker_reports import WorkerReports
from renderers.cache import SHARED

OPEN_PATHS = frozenset({"/healthz", "/readyz"})
"""Paths that need no token, for monitoring."""
MONITORING_PATHS = frozenset({"/healthz", "/readyz", "/metrics"})
"""Paths that respond during the start. Their requests are logged at debug level."""
_DETAILS: Final = "Problems and figures of the interfaces are shown with 'Authorization: Bearer TOKEN'."

_EXAMPLE = {"status": "ready", "interfaces": {"render": {"state": "ready", "where": "/render"}}}
_NOT_READY: Responses = {
    503: {
        "description": "Not ready; the body has the reason.",
        "content": {"application/json": {"example": {**_EXAMPLE, "status": "starting"}}},
    }
}
_METRICS: Responses = {
    200: {
        "description": "Prometheus' text format.",
        "content": {"text/plain": {"schema": {"type": "string"}, "example": "scenegate_http_requests_in_flight 1.0\n"}},
    }
}


def router(
    registry: ServiceRegistry,
    metrics: Metrics,
    version: str,
    readiness: Callable[[], str] | None = None,
    reports: WorkerReports | None = None,
) -> APIRouter:
    """Return the routes for monitoring.

    Args:
        readiness: returns the status of this process for ``/readyz``; default: that of the registry.
        reports: reports of all processes, if there are several (``--workers``).
    """
    routes = APIRouter(tags=["Health and metrics"])
    own_readiness = readiness or registry.verdict

    async def describe(request: Request) -> dict[str, Any]:
        details = _may_see_details(request)
        described = registry.describe(details=details) | ({} if details else {"details": _DETAILS})
        if reports is not None:
            described["status"], described["workers"] = await asyncio.to_thread(reports.describe, own_readiness())
        return described

    @routes.get("/healthz", summary="Liveness", responses=json_example({"version": "1.2.3", **_EXAMPLE}))
    async def healthz(request: Request) -> Response:
        """200 while the event loop runs. The body has the state of each interface, its figures and its problems; if the
        gateway has a token, figures and problems need it. ``caches`` has the bytes that each cache holds, and the limit
        of all together. With --workers, the body has the state of each process, too,
        and the interfaces are those of the responding process."""
        described = {"version": version, **await describe(request)}
        if _may_see_details(request):
            bytes_by_cache = {name: cache.nbytes for name, cache in SHARED.figures().items()}
            described["caches"] = {"limit_bytes": SHARED.max_bytes, "bytes": bytes_by_cache}
        return _json(described)

    @routes.get("/readyz", summary="Readiness", responses=json_example(_EXAMPLE) | _NOT_READY)
    async def readyz(request: Request) -> Response:
        """200 when the kernels are loaded and every interface has started or failed. 503 before, while stopping, and
        while kernels, the render endpoint or the state have failed. A process that only renders also responds with 503
        while its queue is full, or while every worker thread has used more than half of a render's time limit. With
        --workers: 503 until each process was ready once; later 200 while at least one of them is."""
        health = await describe(request)
        if reports is None:
            health["status"] = own_readiness()
        return _json(health, 200 if health["status"] in ("ready", "degraded") else 503)

    @routes.get("/metrics", summary="Prometheus metrics", response_class=Response, responses=_METRICS)
    async def prometheus() -> Response:
        """Requests by route and status, durations, the queue, the process."""
        text = metrics.exposition()
        if reports is not None:
            text = await asyncio.to_thread(reports.sum_metrics, text.decode())
        return Response(text, media_type=CONTENT_TYPE)

    return routes


def _json(value: dict[str, Any], status_code: int = 200) -> Response:
    """Return a JSON response in ASCII: names of files may have bytes that are no UTF-8."""
    return Response(json.dumps(value, separators=(",", ":")), status_code, media_type="application/json")


def _may_see_details(request: Request) -> bool:
    return bool(request.scope.get(AUTHORIZED, True))
