"""REST routes of fault injection. They respond with 403 unless the gateway was started with ``--stereo-faults``."""

from typing import Any, Final

import msgspec
from fastapi import APIRouter, Request

from gateway.adapters.stereo.routes.node_routes import decode
from gateway.adapters.stereo.routes.rest_common import (
    Pipeline,
    RestError,
    error_responses,
    find_pipeline,
    new_router,
    read_body,
)
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream.faults import CUT_REASON, FaultInjector, Faults
from gateway.runtime.http.openapi import example, json_example

MAX_BODY: Final = 4096
"""Maximum size of a body, bytes. All fields together take about 200."""
FAULTS_OFF: Final = "fault injection is off; start the gateway with --stereo-faults"

_EXAMPLE_STATUS: Final = {**msgspec.to_builtins(Faults(drop=0.1, delay=0.5)), "dropped": 12}
_SCHEMAS: Final = msgspec.json.schema_components([Faults])[1]
"""JSON schemas by name."""
_FAULTS_BODY: Final = {
    "requestBody": {
        "required": True,
        "description": "Faults from now on. A field that is left out means no such fault.",
        "content": {
            "application/json": {"schema": _SCHEMAS["Faults"], "examples": example({"drop": 0.1, "delay": 0.5})}
        },
    }
}

_COMMON_ERRORS: Final = error_responses(
    {403: "Fault injection is off (--stereo-faults).", 404: "There is no such pipeline."}
)
_INVALID_BODY: Final = error_responses({400: "Invalid body; the message is the reason.", 413: "The body is too large."})


def fault_router(*services: StereoService) -> APIRouter:
    """Return the routes: GET, PUT and DELETE ``/stereo/faults``, and POST ``/stereo/faults/disconnect``, which cuts all
    image streams."""
    routes = new_router(_COMMON_ERRORS)

    def find_injector(pipeline: int) -> FaultInjector:
        injector = find_pipeline(services, pipeline).injector
        if injector is None:
            raise RestError(403, FAULTS_OFF)
        return injector

    @routes.get("/stereo/faults", summary="Faults in force", responses=json_example(_EXAMPLE_STATUS))
    async def get_faults(pipeline: Pipeline = 0) -> Any:
        return _status(find_injector(pipeline))

    @routes.put(
        "/stereo/faults",
        summary="Inject faults",
        responses=json_example(_EXAMPLE_STATUS) | _INVALID_BODY,
        openapi_extra=_FAULTS_BODY,
    )
    async def put_faults(request: Request, pipeline: Pipeline = 0) -> Any:
        injector = find_injector(pipeline)
        injector.set(decode(Faults, await read_body(request, MAX_BODY), '{"drop": 0.1, "delay": 0.5}'))
        return _status(injector)

    @routes.delete(
        "/stereo/faults",
        summary="End all faults",
        responses=json_example({**msgspec.to_builtins(Faults()), "dropped": 12}),
    )
    async def delete_faults(pipeline: Pipeline = 0) -> Any:
        injector = find_injector(pipeline)
        injector.set(Faults())
        return _status(injector)

    @routes.post("/stereo/faults/disconnect", summary="Cut every stream now", responses=json_example({"streams": 2}))
    async def disconnect(pipeline: Pipeline = 0) -> Any:
        find_injector(pipeline)
        hub = services[pipeline].hub
        streams = len(hub)
        for kind in hub.kinds:
            hub.end_streams(kind, CUT_REASON)
        return {"streams": streams}

    return routes


def _status(injector: FaultInjector) -> dict[str, Any]:
    return {**msgspec.to_builtins(injector.faults), "dropped": injector.dropped}
