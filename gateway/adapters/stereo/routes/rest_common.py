"""Helpers of the stereo camera's REST routes: error responses, bodies with a limit, and the pipeline parameter."""

from collections.abc import Callable, Coroutine, Mapping, Sequence
from typing import Annotated, Any, ClassVar, Final

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import JSONResponse

from gateway.adapters.stereo.device.parameters import ParameterError, UnknownParameterError
from gateway.adapters.stereo.service import StereoService
from gateway.runtime.http.openapi import Responses, example
from gateway.runtime.http.plain_error_route import PlainErrorRoute
from gateway.scene.tree.timeline import TimeError

_ERROR_SCHEMA: Final[dict[str, Any]] = {
    "type": "object",
    "required": ["message", "return_code"],
    "properties": {
        "message": {"type": "string"},
        "return_code": {
            "type": "object",
            "required": ["value", "message"],
            "properties": {"value": {"type": "integer"}, "message": {"type": "string"}},
        },
    },
}


Pipeline = Annotated[
    int, Query(ge=0, description="Number of the camera, where there are several", openapi_examples=example(0))
]


class RestError(Exception):
    """A request is refused with an HTTP status and one sentence."""

    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


def error_response(status: int, message: str, headers: Mapping[str, str] | None = None) -> JSONResponse:
    """Return an error response with a ``return_code``, which Roboception's clients read before the HTTP status."""
    content = {"message": message, "return_code": {"value": -1, "message": message}}
    return JSONResponse(content, status, headers)


def error_responses(descriptions: Mapping[int, str]) -> Responses:
    """Return the OpenAPI description of error responses, by status."""
    return {
        status: {"description": text, "content": {"application/json": {"schema": _ERROR_SCHEMA}}}
        for status, text in descriptions.items()
    }


class RestRoute(PlainErrorRoute):
    """Route whose expected errors become error responses in JSON."""

    statuses: ClassVar[Mapping[type[Exception], int]] = {
        TimeError: 404,
        UnknownParameterError: 404,
        ParameterError: 400,
        **PlainErrorRoute.statuses,
    }

    def get_route_handler(self) -> Callable[[Request], Coroutine[Any, Any, Response]]:
        """Return the function that responds to a request."""
        respond = super().get_route_handler()

        async def respond_or_refuse(request: Request) -> Response:
            try:
                return await respond(request)
            except RestError as error:
                return error_response(error.status, str(error))

        return respond_or_refuse

    def error_response(self, status: int, text: str, headers: Mapping[str, str] | None) -> Response:
        """See ``error_response``."""
        return error_response(status, text, headers)


def new_router(responses: Responses | None = None) -> APIRouter:
    """Return a router for routes of the camera, all of which may have these responses."""
    return APIRouter(tags=["Stereo camera"], responses=responses, route_class=RestRoute)


def find_pipeline(services: Sequence[StereoService], number: int) -> StereoService:
    """Return the camera of a pipeline. Raises RestError if there is none."""
    if number >= len(services):
        raise RestError(404, f"there is no pipeline {number}")
    return services[number]


async def read_body(request: Request, limit: int) -> bytes:
    """Return the body. Raises RestError if it has more than ``limit`` bytes: nothing else limits it."""
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > limit:
            raise RestError(413, f"the body is larger than {limit} bytes")
    return bytes(body)
