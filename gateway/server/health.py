"""``/healthz`` (the process lives), ``/readyz`` (send work), ``/metrics`` (Prometheus)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse

from gateway.runtime.metrics_registry import CONTENT_TYPE, Metrics
from gateway.runtime.service_registry import ServiceRegistry
from gateway.server.access import AUTHORIZED
from gateway.server.openapi import Responses, json_example

OPEN_PATHS = frozenset({"/healthz", "/readyz"})
"""Paths that need no token, for monitoring."""
PATHS = frozenset({"/healthz", "/readyz", "/metrics"})
"""Paths that respond during the start, and are logged at debug level only."""
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
    started: Callable[[], bool] = lambda: True,
    busy: Callable[[], bool] = lambda: False,
) -> APIRouter:
    """Return the routes for operations.

    Args:
        started: returns whether requests are accepted.
        busy: returns whether another request would be rejected or wait long, for load balancers.
    """
    routes = APIRouter(tags=["operations"])

    @routes.get("/healthz", summary="Liveness", responses=json_example({"version": version, **_EXAMPLE}))
    async def healthz(request: Request) -> JSONResponse:
        """200 while the event loop runs. The body has the state of each interface and, with a token if the gateway has
        one, its figures and problems."""
        return JSONResponse({"version": version, **_health(registry, request)})

    @routes.get("/readyz", summary="Readiness", responses=json_example(_EXAMPLE) | _NOT_READY)
    async def readyz(request: Request) -> JSONResponse:
        """200 when the kernels are loaded and every interface has started or failed. 503 before, and while stopping. A
        process that only renders also responds with 503 while its queue is full, or while every worker thread has
        used more than half of a render's time limit."""
        health = _health(registry, request)
        if health["status"] in ("ready", "degraded") and not started():
            health["status"] = "starting"
        if health["status"] == "ready" and busy():
            health["status"] = "busy"
        return JSONResponse(health, status_code=200 if health["status"] in ("ready", "degraded") else 503)

    @routes.get("/metrics", summary="Prometheus metrics", response_class=Response, responses=_METRICS)
    async def prometheus() -> Response:
        """Requests by route and status, durations, the queue, the process."""
        return Response(metrics.exposition(), media_type=CONTENT_TYPE)

    return routes


def _health(registry: ServiceRegistry, request: Request) -> dict[str, Any]:
    if request.scope.get(AUTHORIZED, True):
        return registry.describe()
    return {**registry.describe(details=False), "details": _DETAILS}
