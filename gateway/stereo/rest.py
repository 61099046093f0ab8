"""The device's REST interface, as far as the image stream depends on it."""

from __future__ import annotations

from typing import Any

import msgspec
from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse

from gateway.stereo import device
from gateway.stereo.parameter_specs import NODE_ALIASES, NODES
from gateway.stereo.parameters import ParameterError, UnknownParameterError
from gateway.stereo.service import StereoService

MAX_BODY = 64 << 10
"""Bytes; all parameters of a node together take two thousand."""
_TAGS: list[Any] = ["Stereo camera"]


_REFUSED: dict[str, Any] = {
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
_REFUSALS: dict[int | str, dict[str, Any]] = {
    status: {"description": text, "content": {"application/json": {"schema": _REFUSED}}}
    for status, text in {
        400: "A value cannot be set; the message names the parameter and the limit.",
        404: "There is no such node, parameter or service.",
        413: "The body is too large.",
        507: "The values are set, but could not be stored (--state).",
    }.items()
}
_VALUE: dict[str, Any] = {"type": "object", "required": ["value"], "properties": {"value": {}}}
_NAMED: dict[str, Any] = {
    **_VALUE,
    "required": ["name", "value"],
    "properties": {"name": {"type": "string"}, "value": {}},
}


def _taking(schema: dict[str, Any]) -> dict[str, Any]:
    """What a route reads by itself, for the description."""
    text = "Or in the query, as the device takes it, too: ?name=value, ?value=1."
    return {"requestBody": {"required": True, "description": text, "content": {"application/json": {"schema": schema}}}}


class _Refusal(Exception):  # noqa: N818 - an answer
    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


class _Put(msgspec.Struct, forbid_unknown_fields=False):
    value: Any


class _Named(msgspec.Struct, forbid_unknown_fields=False):
    name: str
    value: Any


_PUTS = msgspec.json.Decoder(_Put)
_LISTS = msgspec.json.Decoder(list[_Named])


def router(*services: StereoService) -> APIRouter:
    """Routes below ``/api``: version 2 for every pipeline, version 1 for the first one, and the paths that the manual's
    examples misspell.

    Args:
        services: pipeline 0, 1, …; at least one.
    """
    api = APIRouter(tags=_TAGS, responses=_REFUSALS)

    async def system() -> Any:
        return device.system(services)

    async def nothing() -> list[Any]:
        return []

    async def pipelines() -> Any:
        return device.pipelines(services)

    for version in ("v1", "v2"):
        api.add_api_route(f"/api/{version}/system", system, methods=["GET"], summary="System")
        api.add_api_route(f"/api/{version}/datastreams", nothing, methods=["GET"], summary="Data streams: none")
    api.add_api_route("/api/v2/pipelines", pipelines, methods=["GET"], summary="Pipelines: one per camera")
    for number, service in enumerate(services):
        _add_nodes(api, f"/api/v2/pipelines/{number}/nodes", service)
    _add_nodes(api, "/api/v1/nodes", services[0])
    return api


def _add_nodes(api: APIRouter, base: str, service: StereoService) -> None:
    @api.get(base, summary="Nodes")
    async def nodes() -> Any:
        return [device.node_info(name) for name in NODES]

    @api.get(base + "/{node}", summary="A node")
    async def one(node: str) -> Any:
        return _answer(lambda: device.node_info(_node(node)))

    @api.get(base + "/{node}/status", summary="Status values of a node")
    async def status(node: str) -> Any:
        return _answer(lambda: device.status(service, _node(node)))

    @api.get(base + "/{node}/parameters", summary="Parameters of a node")
    async def parameters(node: str, request: Request) -> Any:
        return _answer(lambda: _describe(service, _node(node), request.query_params.getlist("name")))

    @api.put(
        base + "/{node}/parameters",
        summary="Set parameters: all or none",
        openapi_extra=_taking({"type": "array", "items": _NAMED}),
    )
    # The manual's examples have `.../parameters/parameters?x=` and `.../services/parameters?x=`; users copy them.
    @api.put(base + "/{node}/parameters/parameters", include_in_schema=False)
    @api.put(base + "/{node}/services/parameters", include_in_schema=False)
    async def put_parameters(node: str, request: Request) -> Any:
        try:
            name, values = _node(node), await _assignments(request)
            names = _set(service, name, values)
            await _stored(service)
            return _describe(service, name, names)
        except _Refusal as refusal:
            return _refused(refusal)

    @api.get(base + "/{node}/parameters/{name}", summary="A parameter")
    async def parameter(node: str, name: str) -> Any:
        return _answer(lambda: _describe(service, _node(node), [name])[0])

    @api.put(base + "/{node}/parameters/{name}", summary="Set a parameter", openapi_extra=_taking(_VALUE))
    async def put_parameter(node: str, name: str, request: Request) -> Any:
        try:
            value = await _single(request)
            names = _set(service, _node(node), [(name, value)])
            await _stored(service)
            return _describe(service, _node(node), names)[0]
        except _Refusal as refusal:
            return _refused(refusal)

    @api.get(base + "/{node}/services", summary="Services of a node")
    async def services(node: str) -> Any:
        return _answer(lambda: [device.service_info(_node(node), name) for name in device.SERVICES[_node(node)]])

    @api.get(base + "/{node}/services/{name}", summary="A service")
    async def one_service(node: str, name: str) -> Any:
        return _answer(lambda: device.service_info(_node(node), name))

    @api.put(base + "/{node}/services/{name}", summary="Call a service")
    async def call(node: str, name: str, request: Request) -> Any:
        try:
            await _body(request)  # none of the services has arguments
            answer = device.call(service, _node(node), name)
            await _stored(service)
            return answer
        except KeyError:
            return _refused(_Refusal(404, f"{node} has no service {name!r}"))
        except _Refusal as refusal:
            return _refused(refusal)


def _answer(make: Any) -> Any:
    try:
        return make()
    except _Refusal as refusal:
        return _refused(refusal)
    except KeyError as error:
        return _refused(_Refusal(404, f"there is no {error}"))


def _refused(refusal: _Refusal) -> JSONResponse:
    # Roboception's own clients look into return_code before they look at the status.
    body = {"message": str(refusal), "return_code": {"value": -1, "message": str(refusal)}}
    return JSONResponse(body, refusal.status)


def _node(name: str) -> str:
    name = NODE_ALIASES.get(name, name)
    if name not in NODES:
        raise _Refusal(404, f"there is no node {name[:80]!r}; there are {', '.join(NODES)}")
    return name


def _describe(service: StereoService, node: str, names: list[str]) -> list[dict[str, Any]]:
    try:
        return [service.parameters.describe(node, name) for name in names or NODES[node]]
    except UnknownParameterError as error:
        raise _Refusal(404, str(error)) from None


def _set(service: StereoService, node: str, values: list[tuple[str, object]]) -> list[str]:
    try:
        return service.set_parameters(node, values)
    except UnknownParameterError as error:
        raise _Refusal(404, str(error)) from None
    except ParameterError as error:
        raise _Refusal(400, str(error)) from None


async def _stored(service: StereoService) -> None:
    """What was set is not acknowledged before it is stored, where there is a state."""
    problem = await service.stored() if service.stored is not None else ""
    if problem:
        raise _Refusal(507, f"the values are set, but could not be stored: {problem}")


async def _body(request: Request) -> bytes:
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > MAX_BODY:
            raise _Refusal(413, f"the body is larger than {MAX_BODY} bytes")
    return bytes(body)


async def _assignments(request: Request) -> list[tuple[str, object]]:
    """Names and values from the query or, without one, from the body."""
    body = await _body(request)
    query = request.query_params.multi_items()
    if query:
        return list(query)
    entries: list[_Named] = _decode(_LISTS, body, '[{"name": "quality", "value": "High"}]')
    return [(entry.name, entry.value) for entry in entries]


async def _single(request: Request) -> object:
    body = await _body(request)
    if not body and "value" in request.query_params:
        return request.query_params["value"]
    put: _Put = _decode(_PUTS, body, '{"value": 1.0}')
    return put.value


def _decode(decoder: msgspec.json.Decoder[Any], body: bytes, like: str) -> Any:
    try:
        return decoder.decode(body)
    except msgspec.DecodeError as error:
        raise _Refusal(400, f"the body is not like {like}: {error}") from None
    except RecursionError:
        raise _Refusal(400, f"the body is not like {like}: it is nested too deep") from None
