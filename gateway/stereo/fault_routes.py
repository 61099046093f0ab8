"""REST for faults: off unless the operator has allowed it."""

from __future__ import annotations

from typing import Annotated, Any, Final

import msgspec
from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse

from gateway.server.openapi import Responses, example, json_example
from gateway.stereo.faults import CUT, Faults
from gateway.stereo.service import StereoService

MAX_BODY: Final = 4096
"""Bytes; all fields together take two hundred."""
OFF: Final = "fault injection is off; start the gateway with --stereo-faults"

_MESSAGE: Final = {"type": "object", "required": ["message"], "properties": {"message": {"type": "string"}}}


def _refusals(*statuses: int) -> Responses:
    """Refusals of a route, for its description."""
    texts = {
        400: "The body cannot be used; the message tells why.",
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
    """``/stereo/faults``: GET shows, PUT replaces, DELETE ends; ``POST …/disconnect`` cuts every stream now."""
    api = APIRouter(tags=["Stereo camera"], responses=_refusals(403, 404))

    def find(pipeline: int) -> StereoService | JSONResponse:
        if pipeline >= len(services):
            return JSONResponse({"message": f"there is no pipeline {pipeline}"}, 404)
        service = services[pipeline]
        return service if service.config.faults else JSONResponse({"message": OFF}, 403)

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
        responses=json_example(_SHOWN) | _refusals(400, 413),
        openapi_extra=_BODY,
    )
    async def put(request: Request, pipeline: Pipeline = 0) -> Any:
        service = find(pipeline)
        if isinstance(service, JSONResponse):
            return service
        body = bytearray()
        async for chunk in request.stream():
            body += chunk
            if len(body) > MAX_BODY:
                return JSONResponse({"message": f"the body is larger than {MAX_BODY} bytes"}, 413)
        try:
            service.injector.set(msgspec.json.decode(bytes(body), type=Faults))
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
            service.hub.fail(kind, CUT)
        return {"streams": streams}

    return api
