"""The device's REST routes outside of camera nodes: system, time, logs, pipelines, data streams and global nodes."""

import time
from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any, Final, Literal

from fastapi import APIRouter, Path, Query
from fastapi.responses import JSONResponse, PlainTextResponse, Response

from gateway.adapters.stereo.routes import device_content as device
from gateway.adapters.stereo.routes.rest_common import error_response, error_responses, new_router
from gateway.adapters.stereo.routes.setting_routes import UILock, add_setting_routes
from gateway.adapters.stereo.service import StereoService
from gateway.runtime.http.error_handlers import redirect
from gateway.runtime.http.openapi import TEXT, example, json_example
from gateway.runtime.logs.recent_logs import MAX_ENTRIES, LogEntry, stereo_log

LOG_FILE: Final = "stereo.log"
"""Name of the only log."""
_LEVELS: Final = {"debug": "DEBUG", "info": "INFO", "warning": "WARN", "error": "ERROR", "critical": "FATAL"}
"""The device's names of log levels, by ours."""
_LOG_INFO: Final = {"date": 1700000000.04, "name": LOG_FILE, "size": 4711}
_LOG_LINE: Final = {
    "component": "gateway.stereo",
    "level": "INFO",
    "message": "client connected",
    "timestamp": 1700000000.04,
}
_PIPELINE: Final = {"type": "rc_visard", "model_name": "rc_visard 160c", "ready": True}
_SYSTEM: Final[dict[str, Any]] = {
    "ready": True,
    "serial": "00000000",
    "model_name": "rc_visard 160c",
    "firmware": {"active_image": {"image_version": device.IMAGE_VERSION}},
    "pipelines": {"config": {"max_pipelines": 1, "pending_changes": False, "pipelines": {"0": _PIPELINE}}},
}
"""Example of a response, shortened."""


def system_router(*services: StereoService) -> APIRouter:
    """Return the routes below ``/api``. Version 1 has neither pipelines nor global nodes."""
    routes = new_router()
    lock = UILock()
    for version in ("v1", "v2"):
        _add_common_routes(routes, f"/api/{version}", services)
        add_setting_routes(routes, f"/api/{version}/system", services, lock)

    @routes.get("/api/swagger", include_in_schema=False)  # the address of the device's description
    async def swagger() -> Response:
        return redirect("../docs", "", 307)

    @routes.get("/api/v2/pipelines", summary="Pipelines: one per camera", responses=json_example({"0": _PIPELINE}))
    async def pipelines() -> Any:
        return device.pipelines(services)

    @routes.get(
        "/api/v2/nodes", summary="Global nodes: none, since there are no database modules", responses=json_example([])
    )
    async def nodes() -> list[Any]:
        return []

    @routes.get("/api/v2/nodes/{node}", include_in_schema=False)  # responds with 404, as the device does
    async def unknown_node(node: str) -> Response:
        message = f"there is no global node {node[:80]!r}; cameras' nodes are at /api/v2/pipelines/0/nodes"
        return error_response(404, message)

    async def pipeline(number: str) -> Any:
        return device.pipelines(services)[number]

    for number in device.pipelines(services):
        routes.get(
            f"/api/v2/pipelines/{number}",
            summary="A pipeline",
            description="Type, model and state of one stereo camera.",  # else FastAPI takes the docstring of partial
            responses=json_example(_PIPELINE),
        )(partial(pipeline, number))

    @routes.get("/api/v2/pipelines/{number}", include_in_schema=False)
    async def unknown_pipeline(number: str) -> Response:
        return error_response(404, f"there is no pipeline {number[:80]!r}; there are {len(services)}, from 0 on")

    return routes


def _add_common_routes(routes: APIRouter, base: str, services: Sequence[StereoService]) -> None:
    """Add the routes that both versions of the API have."""

    @routes.get(f"{base}/system", summary="System", responses=json_example(_SYSTEM))
    async def system() -> Any:
        return device.system_info(services)

    @routes.get(f"{base}/datastreams", summary="Data streams: none", responses=json_example([]))
    async def datastreams() -> list[Any]:
        return []

    @routes.get(f"{base}/logs", summary="Log files", responses=json_example([_LOG_INFO]))
    async def logs() -> Any:
        return [_log_info(stereo_log.entries(), services[0].started)]

    @routes.get(
        f"{base}/logs/{{log}}",
        summary="A log file",
        responses=error_responses({404: "There is no log of that name."})
        | json_example({**_LOG_INFO, "log": [_LOG_LINE]}, "Log, or its text.", TEXT),
    )
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
            return error_response(404, f"there is no log {log[:80]!r}; there is {LOG_FILE}")
        entries = stereo_log.entries()
        if format == "raw":
            return PlainTextResponse(_log_text(entries))
        newest = [_log_entry(entry) for entry in entries[-limit:]]
        return JSONResponse({**_log_info(entries, services[0].started), "log": newest})


def _log_info(entries: list[LogEntry], started: float) -> dict[str, Any]:
    date = entries[-1].timestamp if entries else started
    return {"date": date, "name": LOG_FILE, "size": len(_log_text(entries).encode())}


def _log_entry(entry: LogEntry) -> dict[str, Any]:
    level = _LEVELS.get(entry.level, "INFO")
    return {"component": entry.logger, "level": level, "message": entry.message, "timestamp": entry.timestamp}


def _log_text(entries: list[LogEntry]) -> str:
    lines = (
        f"{time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime(entry.timestamp))} {_LEVELS.get(entry.level, 'INFO')} "
        f"{entry.logger}: {entry.message}\n"
        for entry in entries
    )
    return "".join(lines)
