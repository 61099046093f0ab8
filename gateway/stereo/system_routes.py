"""REST routes of the device other than the camera nodes: system, time, logs, pipelines, data streams, global nodes."""

from __future__ import annotations

import time
from functools import partial
from typing import Annotated, Any, Final, Literal

from fastapi import APIRouter, Path, Query
from fastapi.responses import JSONResponse, PlainTextResponse, Response

from gateway.runtime.recent_logs import MAX_ENTRIES, LogEntry, recent_logs
from gateway.server.openapi import example, json_example
from gateway.stereo import device
from gateway.stereo.rest_errors import RestError
from gateway.stereo.service import StereoService

LOG_FILE: Final = "stereo.log"
"""Name of the only log."""
_LEVELS: Final = {"debug": "DEBUG", "info": "INFO", "warning": "WARN", "error": "ERROR", "critical": "FATAL"}
"""The device's name of each of our log levels."""
_LOG_INFO: Final = {"date": 1700000000.04, "name": LOG_FILE, "size": 4711}
_LOG_LINE: Final = {
    "component": "gateway.stereo",
    "level": "INFO",
    "message": "client connected",
    "timestamp": 1700000000.04,
}
_PIPELINE: Final = {"type": "rc_visard", "model_name": "rc_visard 160-4", "ready": True}
_SYSTEM: Final[dict[str, Any]] = {
    "ready": True,
    "serial": "00000000",
    "model_name": "rc_visard 160-4",
    "firmware": {"active_image": {"image_version": device.IMAGE_VERSION}},
    "pipelines": {"config": {"max_pipelines": 1, "pending_changes": False, "pipelines": {"0": _PIPELINE}}},
}
"""Part of a response, as an example."""
_MISSING: Final[dict[int | str, dict[str, Any]]] = {
    404: {
        "description": "There is no log of that name.",
        "content": {
            "application/json": {
                "schema": {
                    "type": "object",
                    "required": ["message"],
                    "properties": {"message": {"type": "string"}},
                },
                "example": {"message": "there is no log 'gev.log'; there is stereo.log"},
            }
        },
    }
}


def system_router(*services: StereoService) -> APIRouter:
    """Return the routes below ``/api``. Version 1 has no pipelines and global nodes.

    Args:
        services: pipeline 0, 1, …; at least one.
    """
    api = APIRouter(tags=["Stereo camera"])

    async def system() -> Any:
        return device.system(services)

    async def datastreams() -> list[Any]:
        return []

    async def pipelines() -> Any:
        return device.pipelines(services)

    async def logs() -> Any:
        return [_log_info(_entries(), services[0].started)]

    async def log(
        log: Annotated[
            str,
            Path(
                description="Name of the log",
                json_schema_extra={"enum": [LOG_FILE]},
                openapi_examples=example(LOG_FILE),
            ),
        ],
        format: Annotated[  # noqa: A002 - the device's name
            Literal["json", "raw"], Query(description="JSON or plain text", openapi_examples=example("raw"))
        ] = "json",
        limit: Annotated[
            int, Query(ge=1, le=MAX_ENTRIES, description="Newest entries, in JSON", openapi_examples=example(10))
        ] = 100,
    ) -> Response:
        if log != LOG_FILE:
            return RestError(404, f"there is no log {log[:80]!r}; there is {LOG_FILE}").response()
        entries = _entries()
        if format == "raw":
            return PlainTextResponse(_raw(entries))
        shown = [_log_entry(entry) for entry in entries[-limit:]]
        return JSONResponse({**_log_info(entries, services[0].started), "log": shown})

    async def system_time() -> Any:
        return {"utc": time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime())}

    for version in ("v1", "v2"):
        base = f"/api/{version}"
        api.get(f"{base}/system", summary="System", responses=json_example(_SYSTEM))(system)
        api.get(f"{base}/datastreams", summary="Data streams: none", responses=json_example([]))(datastreams)
        api.get(f"{base}/logs", summary="Log files", responses=json_example([_LOG_INFO]))(logs)
        api.get(
            f"{base}/logs/{{log}}",
            summary="A log file",
            responses={
                **_MISSING,
                200: {
                    "description": "Log, or its text.",
                    "content": {"application/json": {"example": {**_LOG_INFO, "log": [_LOG_LINE]}}, "text/plain": {}},
                },
            },
        )(log)
        api.get(
            f"{base}/system/time",
            summary="System time in UTC",
            responses=json_example({"utc": "2026-01-31 12:00:00"}),
        )(system_time)
    api.get("/api/v2/pipelines", summary="Pipelines: one per camera", responses=json_example({"0": _PIPELINE}))(
        pipelines
    )

    @api.get(
        "/api/v2/nodes",
        summary="Global nodes: none, since there are no database modules",
        responses=json_example([]),
    )
    async def nodes() -> list[Any]:
        return []

    @api.get("/api/v2/nodes/{node}", include_in_schema=False)  # always the device's 404
    async def node(node: str) -> Response:
        message = f"there is no global node {node[:80]!r}; cameras' nodes are at /api/v2/pipelines/0/nodes"
        return RestError(404, message).response()

    async def pipeline(number: str) -> Any:
        return device.pipelines(services)[number]

    for number in device.pipelines(services):
        api.get(f"/api/v2/pipelines/{number}", summary="A pipeline", responses=json_example(_PIPELINE))(
            partial(pipeline, number)
        )

    @api.get("/api/v2/pipelines/{number}", include_in_schema=False)
    async def no_pipeline(number: str) -> Response:
        return RestError(404, f"there is no pipeline {number[:80]!r}; there are {len(services)}, from 0 on").response()

    return api


def _entries() -> list[LogEntry]:
    return recent_logs.entries("stereo")


def _log_info(entries: list[LogEntry], started: float) -> dict[str, Any]:
    """Return the device's LogInfo."""
    date = entries[-1].timestamp if entries else started
    return {"date": date, "name": LOG_FILE, "size": len(_raw(entries).encode())}


def _log_entry(entry: LogEntry) -> dict[str, Any]:
    """Return the device's LogEntry."""
    level = _LEVELS.get(entry.level, "INFO")
    return {"component": entry.logger, "level": level, "message": entry.message, "timestamp": entry.timestamp}


def _raw(entries: list[LogEntry]) -> str:
    lines = (
        f"{time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime(entry.timestamp))} {_LEVELS.get(entry.level, 'INFO')} "
        f"{entry.logger}: {entry.message}\n"
        for entry in entries
    )
    return "".join(lines)
