"""``/healthz`` (the process lives), ``/readyz`` (send work), ``/metrics`` (Prometheus)."""

from __future__ import annotations

from collections.abc import Callable

from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse

from gateway.ops.board import Board
from gateway.ops.metrics import CONTENT_TYPE, Metrics

OPEN_PATHS = frozenset({"/healthz", "/readyz"})
"""Answered without a token: those who watch over processes have none."""
PATHS = frozenset({"/healthz", "/readyz", "/metrics"})
"""Answered from the first moment on, never logged above debug level."""


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

    @routes.get("/healthz", summary="The process lives")
    async def healthz() -> JSONResponse:
        """200 as long as the event loop turns; the body tells the state of each interface."""
        return JSONResponse({"version": version, **board.describe()})

    @routes.get("/readyz", summary="Whether to send work", responses={503: {"description": "Not now; the body tells"}})
    async def readyz() -> JSONResponse:
        """200 when the kernels are warm and every interface has started or failed; 503 before, while stopping and, of a
        process that does nothing but render, while its queue is full or every thread has worked at one picture for more
        than half of its time limit."""
        described = board.describe()
        if described["status"] in ("ready", "degraded") and not started():
            described["status"] = "starting"
        if described["status"] == "ready" and busy():
            described["status"] = "busy"
        return JSONResponse(described, status_code=200 if described["status"] in ("ready", "degraded") else 503)

    @routes.get("/metrics", summary="Prometheus metrics", response_class=Response)
    async def prometheus() -> Response:
        """Requests by path and outcome, durations, the queue, the process."""
        return Response(metrics.exposition(), media_type=CONTENT_TYPE)

    return routes
