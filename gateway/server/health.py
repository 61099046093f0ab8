"""``/healthz`` (the process lives), ``/readyz`` (send work), ``/metrics`` (Prometheus)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from fastapi import APIRouter, Request, Response
from fastapi.responses import JSONResponse

from gateway.runtime.metrics_registry import CONTENT_TYPE, Metrics
from gateway.runtime.service_registry import Board
from gateway.server.access import ADMITTED
from gateway.server.openapi import Responses, json_example

OPEN_PATHS = frozenset({"/healthz", "/readyz"})
"""Answered without a token: those who watch over processes have none."""
PATHS = frozenset({"/healthz", "/readyz", "/metrics"})
"""Answered from the first moment on, never logged above debug level."""
_DETAILS: Final = "Problems and figures of the interfaces are shown with 'Authorization: Bearer TOKEN'."

_DESCRIBED = {"status": "ready", "interfaces": {"render": {"state": "ready", "where": "/render"}}}
_NOT_READY: Responses = {
    503: {
        "description": "Not now; the body tells why.",
        "content": {"application/json": {"example": {**_DESCRIBED, "status": "starting"}}},
    }
}
_METRICS: Responses = {
    200: {
        "description": "Prometheus' text format.",
        "content": {"text/plain": {"schema": {"type": "string"}, "example": "scenegate_http_requests_in_flight 1.0\n"}},
    }
}


def router(
    board: Board,
    metrics: Metrics,
    version: str,
    started: Callable[[], bool] = lambda: True,
    busy: Callable[[], bool] = lambda: False,
) -> APIRouter:
    """The routes of operations.

    Args:
        started: whether requests are let in.
        busy: whether another request would be refused or wait long, for balancers that ask before they send.
    """
    routes = APIRouter(tags=["operations"])

    @routes.get("/healthz", summary="The process lives", responses=json_example({"version": version, **_DESCRIBED}))
    async def healthz(request: Request) -> JSONResponse:
        """200 as long as the event loop turns; the body tells the state of each interface and, with a token where one
        is asked for, its figures and problems."""
        return JSONResponse({"version": version, **_described(board, request)})

    @routes.get("/readyz", summary="Whether to send work", responses=json_example(_DESCRIBED) | _NOT_READY)
    async def readyz(request: Request) -> JSONResponse:
        """200 when the kernels are warm and every interface has started or failed; 503 before, while stopping and, of a
        process that does nothing but render, while its queue is full or every thread has worked at one picture for more
        than half of its time limit."""
        described = _described(board, request)
        if described["status"] in ("ready", "degraded") and not started():
            described["status"] = "starting"
        if described["status"] == "ready" and busy():
            described["status"] = "busy"
        return JSONResponse(described, status_code=200 if described["status"] in ("ready", "degraded") else 503)

    @routes.get("/metrics", summary="Prometheus metrics", response_class=Response, responses=_METRICS)
    async def prometheus() -> Response:
        """Requests by path and outcome, durations, the queue, the process."""
        return Response(metrics.exposition(), media_type=CONTENT_TYPE)

    return routes


def _described(board: Board, request: Request) -> dict[str, Any]:
    if request.scope.get(ADMITTED, True):
        return board.describe()
    return {**board.describe(details=False), "details": _DETAILS}
