"""REST routes of fault injection, disabled unless the operator allows it."""

from __future__ import annotations

from typing import Annotated, Any, Final

import msgspec
from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse

from gateway.server.openapi import Responses, example, json_example
from gateway.stereo.faults import CUT_REASON, Faults
from gateway.stereo.rest_errors import RestError, read_body
from gateway.stereo.service import StereoService

MAX_BODY: Final = 4096
"""Maximum size of a body, bytes. All fields together take two hundred."""
FAULTS_OFF: Final = "fault injection is off; start the gateway with --stereo-faults"

_MESSAGE: Final = {"type": "object", "required": ["message"], "properties": {"message": {"type": "string"}}}


def _error_responses(*statuses: int) -> Responses:
    """Return the error responses of a route."""
    texts = {
        400: "Invalid body; the message is the reason.",
        403: "Fault injection is off (--stereo-faults).",
        404: "There is no such pipeline.",
        413: "The body is too large.",
    }
    content = {"application/json": {"schema": _MESSAGE}}
    return {status: {"description": texts[status], "content": dict(content)} for status in statuses}


_SHOWN: Final = {**msgspec.to_builtins(Faults(drop=0.1, delay=0.5)), "dropped": 12}
_BODY: Final = {
    "requestBody": {
        "required": True,
        "description": "Faults from now on. A field that is left out means no such fault.",
        "content": {
            "application/json": {
                "schema": msgspec.json.schema_components([Faults])[1]["Faults"],
                "examples": example({"drop": 0.1, "delay": 0.5}),
            }
        },
    }
}

Pipeline = Annotated[
    int, Query(ge=0, description="Number of the camera, where there are several", openapi_examples=example(0))
]


def fault_router(*services: StereoService) -> APIRouter:
    """Return the routes: GET, PUT and DELETE of ``/stereo/faults``, and ``POST …/disconnect``, which cuts every
    stream."""
    api = APIRouter(tags=["Stereo camera"], responses=_error_responses(403, 404))

    def find(pipeline: int) -> StereoService | JSONResponse:
        if pipeline >= len(services):
            return JSONResponse({"message": f"there is no pipeline {pipeline}"}, 404)
        service = services[pipeline]
        return service if service.config.faults else JSONResponse({"message": FAULTS_OFF}, 403)

    def shown(service: StereoService) -> dict[str, Any]:
        injector = service.injector
        return {**msgspec.to_builtins(injector.faults), "dropped": injector.dropped}

    @api.get("/stereo/faults", summary="Faults in force", responses=json_example(_SHOWN))
    async def get(pipeline: Pipeline = 0) -> Any:
        service = find(pipeline)
        return service if isinstance(service, JSONResponse) else shown(service)

    @api.put(
        "/stereo/faults",
        summary="Inject faults",
        responses=json_example(_SHOWN) | _error_responses(400, 413),
        openapi_extra=_BODY,
    )
    async def put(request: Request, pipeline: Pipeline = 0) -> Any:
        service = find(pipeline)
        if isinstance(service, JSONResponse):
            return service
        try:
            service.injector.set(msgspec.json.decode(await read_body(request, MAX_BODY), type=Faults))
        except RestError as error:
            return JSONResponse({"message": str(error)}, error.status)
        except msgspec.DecodeError as error:
            return JSONResponse({"message": f'the body is not like {{"drop": 0.1, "delay": 0.5}}: {error}'}, 400)
        return shown(service)

    @api.delete(
        "/stereo/faults",
        summary="End all faults",
        responses=json_example({**msgspec.to_builtins(Faults()), "dropped": 12}),
    )
    async def delete(pipeline: Pipeline = 0) -> Any:
        service = find(pipeline)
        if isinstance(service, JSONResponse):
            return service
        service.injector.set(Faults())
        return shown(service)

    @api.post("/stereo/faults/disconnect", summary="Cut every stream now", responses=json_example({"streams": 2}))
    async def disconnect(pipeline: Pipeline = 0) -> Any:
        service = find(pipeline)
        if isinstance(service, JSONResponse):
            return service
        streams = len(service.hub)
        for kind in service.hub.kinds():
            service.hub.end_streams(kind, CUT_REASON)
        return {"streams": streams}

    return api
