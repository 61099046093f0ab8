"""REST for faults: off unless the operator has allowed it."""

from __future__ import annotations

from typing import Annotated, Any, Final

import msgspec
from fastapi import APIRouter, Query, Request
from fastapi.responses import JSONResponse

from gateway.stereo.faults import CUT, Faults
from gateway.stereo.service import StereoService

MAX_BODY: Final = 4096
"""Bytes; all fields together take two hundred."""
OFF: Final = "fault injection is off; start the gateway with --stereo-faults"

_REFUSALS: Final[dict[int | str, dict[str, Any]]] = {
    400: {"description": "The body is not what is wanted; a sentence tells why"},
    403: {"description": "Fault injection is off"},
    404: {"description": "There is no such pipeline"},
    413: {"description": "The body is too large"},
}

Pipeline = Annotated[int, Query(ge=0, description="Which camera, where there are several")]


def fault_router(*services: StereoService) -> APIRouter:
    """``/stereo/faults``: GET shows, PUT replaces, DELETE ends; ``POST …/disconnect`` cuts every stream now."""
    api = APIRouter(tags=["Stereo camera"], responses=_REFUSALS)

    def find(pipeline: int) -> StereoService | JSONResponse:
        if pipeline >= len(services):
            return JSONResponse({"message": f"there is no pipeline {pipeline}"}, 404)
        service = services[pipeline]
        return service if service.config.faults else JSONResponse({"message": OFF}, 403)

    def shown(service: StereoService) -> dict[str, Any]:
        injector = service.injector
        return {**msgspec.to_builtins(injector.faults), "dropped": injector.dropped}

    @api.get("/stereo/faults", summary="Faults in force")
    async def get(pipeline: Pipeline = 0) -> Any:
        service = find(pipeline)
        return service if isinstance(service, JSONResponse) else shown(service)

    @api.put("/stereo/faults", summary="Let things go wrong: drop, delay, disconnect_after, clock_frozen, clock_offset")
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

    @api.delete("/stereo/faults", summary="Nothing goes wrong any more")
    async def delete(pipeline: Pipeline = 0) -> Any:
        service = find(pipeline)
        if isinstance(service, JSONResponse):
            return service
        service.injector.set(Faults())
        return shown(service)

    @api.post("/stereo/faults/disconnect", summary="Cut every stream now")
    async def disconnect(pipeline: Pipeline = 0) -> Any:
        service = find(pipeline)
        if isinstance(service, JSONResponse):
            return service
        streams = len(service.hub)
        for kind in service.hub.kinds():
            service.hub.fail(kind, CUT)
        return {"streams": streams}

    return api
