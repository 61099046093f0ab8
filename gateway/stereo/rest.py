"""The device's REST interface, as far as the image stream depends on it."""

from __future__ import annotations

from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Path, Query, Request
from fastapi.responses import JSONResponse
from pydantic import Field

from gateway.server.openapi import Responses, example, json_example
from gateway.stereo import device
from gateway.stereo.parameter_specs import NODE_ALIASES, NODES, Spec
from gateway.stereo.parameters import ParameterError, Parameters, UnknownParameterError
from gateway.stereo.service import StereoService

MAX_BODY = 64 << 10
"""Bytes; all parameters of a node together take two thousand."""
MAX_NUMBER = 64
"""Characters of a number in a query."""
_TAGS: list[Any] = ["Stereo camera"]
_RETURN_CODE: dict[str, Any] = {
    "type": "object",
    "required": ["value", "message"],
    "properties": {"value": {"type": "integer"}, "message": {"type": "string"}},
}
REFUSED: dict[str, Any] = {
    "type": "object",
    "required": ["message", "return_code"],
    "properties": {"message": {"type": "string"}, "return_code": _RETURN_CODE},
}
"""JSON schema of a refusal, as the device gives it."""


def _refusals(*statuses: int) -> Responses:
    """Refusals of a route, for its description."""
    texts = {
        400: "The body or a value cannot be used; the message names the parameter and the limit.",
        404: "There is no such node, parameter or service.",
        413: "The body is too large.",
        507: "The values are set, but could not be stored (--state).",
    }
    content = {"application/json": {"schema": REFUSED}}
    return {status: {"description": texts[status], "content": content} for status in statuses}


_SPECS: dict[str, Spec] = {name: spec for specs in NODES.values() for name, spec in specs.items()}
"""Parameters of all nodes by name; no name is in two nodes."""
_NODE_NAMES = [*NODES, *NODE_ALIASES]
_SERVICE_NAMES = list(dict.fromkeys(name for services in device.SERVICES.values() for name in services))

# Names that do not exist are refused by the handlers with the device's 404 and not by FastAPI with 422: the enums are
# for the description.
NodeName = Annotated[
    str,
    Path(
        description="Name of a node",
        json_schema_extra={"enum": _NODE_NAMES},
        openapi_examples=example("rc_stereomatching"),
    ),
]
ParameterName = Annotated[
    str,
    Path(
        description="Name of a parameter of the node",
        json_schema_extra={"enum": list(_SPECS)},
        openapi_examples=example("quality"),
    ),
]
ParameterNames = Annotated[
    list[Annotated[str, Field(json_schema_extra={"enum": list(_SPECS)})]],
    Query(alias="name", description="Parameters to show; none: all of the node", openapi_examples=example(["quality"])),
]
ServiceName = Annotated[
    str,
    Path(
        description="Name of a service of the node",
        json_schema_extra={"enum": _SERVICE_NAMES},
        openapi_examples=example("reset_defaults"),
    ),
]


def _value_schema(spec: Spec) -> dict[str, Any]:
    """JSON schema of a parameter's values."""
    if spec.type == "string":
        return {"type": "string", "enum": [*spec.choices, *spec.aliases]}
    if spec.type == "bool":
        return {"type": ["boolean", "integer"], "minimum": 0, "maximum": 1}
    kind = "integer" if spec.type == "int32" else "number"
    return {"type": kind, "minimum": spec.low, "maximum": spec.high}


def _assignment_schema(spec: Spec) -> dict[str, Any]:
    """JSON schema of an entry that sets a parameter."""
    return {
        "type": "object",
        "title": spec.name,
        "description": spec.description,
        "required": ["name", "value"],
        "properties": {"name": {"const": spec.name}, "value": _value_schema(spec)},
    }


def _body_of(schema: dict[str, Any], shown: Any, text: str, *, required: bool) -> dict[str, Any]:
    """Description of a body that a handler reads itself: it is bounded, and refusals are the device's."""
    content = {"application/json": {"schema": schema, "examples": example(shown)}}
    return {"requestBody": {"required": required, "description": text, "content": content}}


_LIST_BODY = _body_of(
    {"type": "array", "items": {"anyOf": [_assignment_schema(spec) for spec in _SPECS.values()]}},
    [{"name": "quality", "value": "High"}, {"name": "minconf", "value": 0.6}],
    "Parameters of the node. May be left out where the query has them, as in ?quality=High&minconf=0.6; with neither "
    "nothing is set.",
    required=False,
)
_SINGLE_BODY = _body_of(
    {
        "type": "object",
        "required": ["value"],
        "properties": {
            "value": {
                "type": ["number", "string", "boolean"],
                "description": "Within the type and the limits of this parameter, which GET shows.",
            }
        },
    },
    {"value": "High"},
    "The value. ?value=High in the query does as well, without a body.",
    required=True,
)
_CALL_BODY = _body_of(
    {
        "type": "object",
        "properties": {"args": {"type": ["object", "null"], "description": "None of the services has arguments."}},
    },
    {"args": {}},
    "Arguments of the call.",
    required=False,
)


class _Refusal(Exception):  # noqa: N818 - an answer
    def __init__(self, status: int, message: str) -> None:
        super().__init__(message)
        self.status = status


class _Put(msgspec.Struct, forbid_unknown_fields=False):
    value: Any


class _Named(msgspec.Struct, forbid_unknown_fields=False):
    name: str
    value: Any


class _Call(msgspec.Struct, forbid_unknown_fields=False):
    args: dict[str, Any] | None = None


_PUTS = msgspec.json.Decoder(_Put)
_CALLS = msgspec.json.Decoder(_Call)
_LISTS = msgspec.json.Decoder(list[_Named])


def router(*services: StereoService) -> APIRouter:
    """Routes below ``/api``: version 2 for every pipeline, version 1 for the first one, and the paths that the manual's
    examples misspell.

    Args:
        services: pipeline 0, 1, …; at least one.
    """
    api = APIRouter(tags=_TAGS)

    async def system() -> Any:
        return device.system(services)

    async def nothing() -> list[Any]:
        return []

    async def pipelines() -> Any:
        return device.pipelines(services)

    get: Any = {"methods": ["GET"]}
    for version in ("v1", "v2"):
        base = f"/api/{version}"
        api.add_api_route(f"{base}/system", system, summary="System", responses=json_example(_SYSTEM), **get)
        api.add_api_route(
            f"{base}/datastreams", nothing, summary="Data streams: none", responses=json_example([]), **get
        )
    shown = json_example({"0": _SYSTEM["pipelines"]["config"]["pipelines"]["0"]})
    api.add_api_route("/api/v2/pipelines", pipelines, summary="Pipelines: one per camera", responses=shown, **get)
    for number, service in enumerate(services):
        _add_nodes(api, f"/api/v2/pipelines/{number}/nodes", service)
    _add_nodes(api, "/api/v1/nodes", services[0])
    return api


_PIPELINE = {"type": "rc_visard", "model_name": "rc_visard 160-4", "ready": True}
_SYSTEM: dict[str, Any] = {
    "ready": True,
    "serial": "00000000",
    "model_name": "rc_visard 160-4",
    "firmware": {"active_image": {"image_version": device.IMAGE_VERSION}},
    "pipelines": {"config": {"max_pipelines": 1, "pending_changes": False, "pipelines": {"0": _PIPELINE}}},
}
"""Part of a response, for the description."""
_NODE = device.node_info("rc_stereomatching")
_STATUS = {"status": "running", "timestamp": 1700000000.04, "values": {"fps": "25", "width": "640", "height": "480"}}
_QUALITY = Parameters().describe("rc_stereomatching", "quality")
_MINCONF = {**Parameters().describe("rc_stereomatching", "minconf"), "value": 0.6}
_SERVICE = device.service_info("rc_stereomatching", "reset_defaults")
_CALLED = {"name": "reset_defaults", "response": {"return_code": {"value": 0, "message": ""}}}


def _add_nodes(api: APIRouter, base: str, service: StereoService) -> None:
    @api.get(base, summary="Nodes", responses=json_example([_NODE]))
    async def nodes() -> Any:
        return [device.node_info(name) for name in NODES]

    @api.get(base + "/{node}", summary="A node", responses=json_example(_NODE) | _refusals(404))
    async def one(node: NodeName) -> Any:
        return _answer(lambda: device.node_info(_node(node)))

    @api.get(
        base + "/{node}/status", summary="Status values of a node", responses=json_example(_STATUS) | _refusals(404)
    )
    async def status(node: NodeName) -> Any:
        return _answer(lambda: device.status(service, _node(node)))

    @api.get(
        base + "/{node}/parameters",
        summary="Parameters of a node",
        responses=json_example([_QUALITY]) | _refusals(404),
    )
    async def parameters(node: NodeName, names: ParameterNames = []) -> Any:  # noqa: B006 - FastAPI makes a new one
        return _answer(lambda: _describe(service, _node(node), names))

    @api.put(
        base + "/{node}/parameters",
        summary="Set parameters: all or none",
        responses=json_example([_QUALITY, _MINCONF]) | _refusals(400, 404, 413, 507),
        openapi_extra=_LIST_BODY,
    )
    # The manual's examples have `.../parameters/parameters?x=` and `.../services/parameters?x=`; users copy them.
    @api.put(base + "/{node}/parameters/parameters", include_in_schema=False)
    @api.put(base + "/{node}/services/parameters", include_in_schema=False)
    async def put_parameters(node: NodeName, request: Request) -> Any:
        try:
            name, values = _node(node), await _assignments(request)
            names = _set(service, name, values)
            await _stored(service)
            return _describe(service, name, names)
        except _Refusal as refusal:
            return _refused(refusal)

    @api.get(
        base + "/{node}/parameters/{name}",
        summary="A parameter",
        responses=json_example(_QUALITY) | _refusals(404),
    )
    async def parameter(node: NodeName, name: ParameterName) -> Any:
        return _answer(lambda: _describe(service, _node(node), [name])[0])

    @api.put(
        base + "/{node}/parameters/{name}",
        summary="Set a parameter",
        responses=json_example(_QUALITY) | _refusals(400, 404, 413, 507),
        openapi_extra=_SINGLE_BODY,
    )
    async def put_parameter(node: NodeName, name: ParameterName, request: Request) -> Any:
        try:
            value = await _single(request)
            names = _set(service, _node(node), [(name, value)])
            await _stored(service)
            return _describe(service, _node(node), names)[0]
        except _Refusal as refusal:
            return _refused(refusal)

    @api.get(
        base + "/{node}/services",
        summary="Services of a node",
        responses=json_example([_SERVICE]) | _refusals(404),
    )
    async def services(node: NodeName) -> Any:
        return _answer(lambda: [device.service_info(_node(node), name) for name in device.SERVICES[_node(node)]])

    @api.get(base + "/{node}/services/{name}", summary="A service", responses=json_example(_SERVICE) | _refusals(404))
    async def one_service(node: NodeName, name: ServiceName) -> Any:
        return _answer(lambda: device.service_info(_node(node), name))

    @api.put(
        base + "/{node}/services/{name}",
        summary="Call a service",
        responses=json_example(_CALLED) | _refusals(400, 404, 413, 507),
        openapi_extra=_CALL_BODY,
    )
    async def call(node: NodeName, name: ServiceName, request: Request) -> Any:
        try:
            if body := await _body(request):
                _decode(_CALLS, body, '{"args": {}}')
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
    """Names and values from the query, then those from the body; each may be missing."""
    body = await _body(request)
    values: list[tuple[str, object]] = [(name, _meant(text)) for name, text in request.query_params.multi_items()]
    if body:
        entries: list[_Named] = _decode(_LISTS, body, '[{"name": "quality", "value": "High"}]')
        values += [(entry.name, entry.value) for entry in entries]
    return values


async def _single(request: Request) -> object:
    body = await _body(request)
    if not body and "value" in request.query_params:
        return _meant(request.query_params["value"])
    put: _Put = _decode(_PUTS, body, '{"value": 1.0}')
    return put.value


def _meant(text: str) -> object:
    """The value that a text of a query means: a boolean, a number or the text itself."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        return float(text) if len(text) < MAX_NUMBER else text
    except ValueError:
        return text


def _decode(decoder: msgspec.json.Decoder[Any], body: bytes, like: str) -> Any:
    try:
        return decoder.decode(body)
    except msgspec.DecodeError as error:
        raise _Refusal(400, f"the body is not like {like}: {error}") from None
    except RecursionError:
        raise _Refusal(400, f"the body is not like {like}: it is nested too deep") from None
