"""REST routes of the device's nodes: parameters, status values and services; their OpenAPI description."""

from typing import Annotated, Any, Final

import msgspec
from fastapi import APIRouter, Path, Query, Request
from pydantic import Field

from gateway.adapters.stereo.device.parameter_specs import NODE_ALIASES, NODES, Spec
from gateway.adapters.stereo.device.parameters import Parameters
from gateway.adapters.stereo.routes import device_content as device
from gateway.adapters.stereo.routes.rest_common import RestError, error_responses, new_router, read_body
from gateway.adapters.stereo.service import StereoService
from gateway.runtime.http.openapi import Responses, example, json_example

_SPECS: Final[dict[str, Spec]] = {name: spec for specs in NODES.values() for name, spec in specs.items()}
"""Parameters of all nodes by name. No two nodes have a parameter of the same name."""
_SERVICE_NAMES: Final = list(dict.fromkeys(name for services in device.SERVICES.values() for name in services))

# The enums describe the names, but do not validate them. For unknown names, the handlers return 404 as the device does;
# FastAPI would return 422. Swagger UI fills its form with the default of an enum, not with the example.
NodeName = Annotated[
    str,
    Path(
        description="Name of a node",
        json_schema_extra={"enum": [*NODES, *NODE_ALIASES], "default": "rc_stereomatching"},
        openapi_examples=example("rc_stereomatching"),
    ),
]
ParameterName = Annotated[
    str,
    Path(
        description="Name of a parameter of the node",
        json_schema_extra={"enum": list(_SPECS), "default": "quality"},
        openapi_examples=example("quality"),
    ),
]
ParameterNames = Annotated[
    list[Annotated[str, Field(json_schema_extra={"enum": list(_SPECS)})]],
    Query(
        alias="name",
        description="Names of the parameters to return; by default all of the node",
        openapi_examples=example(["quality"]),
    ),
]
ServiceName = Annotated[
    str,
    Path(
        description="Name of a service of the node",
        json_schema_extra={"enum": _SERVICE_NAMES, "default": "reset_defaults"},
        openapi_examples=example("reset_defaults"),
    ),
]


def node_errors(*statuses: int) -> Responses:
    """Return the error responses of a node's route."""
    descriptions = {
        400: "Invalid body or value; the message names the parameter and the limit.",
        404: "There is no such node, parameter or service.",
        413: "The body is too large.",
        507: "The values are set, but could not be stored (--state).",
    }
    return error_responses({status: descriptions[status] for status in statuses})


def _value_schema(spec: Spec) -> dict[str, Any]:
    if spec.type == "string":
        return {"type": "string", "enum": [*spec.choices, *spec.aliases]}
    if spec.type == "bool":
        return {"type": ["boolean", "integer"], "minimum": 0, "maximum": 1}
    kind = "integer" if spec.type == "int32" else "number"
    return {"type": kind, "minimum": spec.minimum, "maximum": spec.maximum}


def _assignment_schema(spec: Spec) -> dict[str, Any]:
    return {
        "type": "object",
        "title": spec.name,
        "description": spec.description,
        "required": ["name", "value"],
        "properties": {"name": {"const": spec.name}, "value": _value_schema(spec)},
    }


def _body(schema: dict[str, Any], example_body: Any, description: str, *, required: bool) -> dict[str, Any]:
    """Return the description of a body that the handler decodes itself."""
    content = {"application/json": {"schema": schema, "examples": example(example_body)}}
    return {"requestBody": {"required": required, "description": description, "content": content}}


ASSIGNMENTS_BODY: Final = _body(
    {"type": "array", "items": {"anyOf": [_assignment_schema(spec) for spec in _SPECS.values()]}},
    [{"name": "quality", "value": "High"}, {"name": "minconf", "value": 0.6}],
    "Parameters of the node. Optional: parameters in the query, as in ?quality=High&minconf=0.6, are set as well.",
    required=False,
)
VALUE_BODY: Final = _body(
    {
        "type": "object",
        "required": ["value"],
        "properties": {
            "value": {
                "type": ["number", "string", "boolean"],
                "description": "A value of the parameter's type and within its limits, as shown by GET.",
            }
        },
    },
    {"value": "High"},
    "The value. ?value=High in the query has the same effect without a body.",
    required=True,
)
CALL_BODY: Final = _body(
    {
        "type": "object",
        "properties": {"args": {"type": ["object", "null"], "description": "Only `measure_depth` has arguments."}},
    },
    {"args": {}},
    "Arguments of the call.",
    required=False,
)

_NODE: Final = device.node_info("rc_stereomatching")
_STATUS: Final = {
    "status": "running",
    "timestamp": 1700000000.04,
    "values": {"fps": "25", "width": "640", "height": "480"},
}
_QUALITY: Final = Parameters().describe("rc_stereomatching", "quality")
_MINCONF: Final = {**Parameters().describe("rc_stereomatching", "minconf"), "value": 0.6}
_SERVICE: Final = device.service_info("rc_stereomatching", "reset_defaults")

NODES_RESPONSE: Final = json_example([_NODE])
NODE_RESPONSE: Final = json_example(_NODE)
STATUS_RESPONSE: Final = json_example(_STATUS)
PARAMETERS_RESPONSE: Final = json_example([_QUALITY])
ASSIGNED_RESPONSE: Final = json_example([_QUALITY, _MINCONF])
PARAMETER_RESPONSE: Final = json_example(_QUALITY)
SERVICES_RESPONSE: Final = json_example([_SERVICE])
SERVICE_RESPONSE: Final = json_example(_SERVICE)
CALL_RESPONSE: Final = json_example(
    {"name": "reset_defaults", "response": {"return_code": {"value": 0, "message": ""}}}
)


MAX_BODY: Final = 64 << 10
"""Maximum size of a body, bytes. All parameters of a node take about 2000."""
NUMBER_TEXT_LIMIT: Final = 64
"""Number of characters from which a query value is text: no number of a parameter is as long."""


class _ValueBody(msgspec.Struct):
    """Body that sets one parameter."""

    value: Any


class _Assignment(msgspec.Struct):
    """Entry of a body that sets several parameters."""

    name: str
    value: Any


class _CallBody(msgspec.Struct):
    """Body of a service call."""

    args: dict[str, Any] | None = None


def node_router(*services: StereoService) -> APIRouter:
    """Return the routes below ``/api``: version 2 for every pipeline, 0, 1, …; version 1 for the first one."""
    routes = new_router()
    bases = [f"/api/v2/pipelines/{number}/nodes" for number in range(len(services))]
    for base, service in zip([*bases, "/api/v1/nodes"], [*services, services[0]], strict=True):
        _add_node_routes(routes, base, service)
        _add_service_routes(routes, base, service)
    return routes


def _add_node_routes(routes: APIRouter, base: str, service: StereoService) -> None:
    @routes.get(base, summary="Nodes", responses=NODES_RESPONSE)
    async def nodes() -> Any:
        return [device.node_info(name) for name in NODES]

    @routes.get(base + "/{node}", summary="A node", responses=NODE_RESPONSE | node_errors(404))
    async def node_info(node: NodeName) -> Any:
        return device.node_info(_current_name(node))

    @routes.get(
        base + "/{node}/status", summary="Status values of a node", responses=STATUS_RESPONSE | node_errors(404)
    )
    async def status(node: NodeName) -> Any:
        return device.node_status(service, _current_name(node))

    @routes.get(
        base + "/{node}/parameters", summary="Parameters of a node", responses=PARAMETERS_RESPONSE | node_errors(404)
    )
    async def parameters(node: NodeName, names: ParameterNames = []) -> Any:  # noqa: B006 - FastAPI copies it
        return _describe(service, _current_name(node), names)

    @routes.put(
        base + "/{node}/parameters",
        summary="Set parameters: all or none",
        responses=ASSIGNED_RESPONSE | node_errors(400, 404, 413, 507),
        openapi_extra=ASSIGNMENTS_BODY,
    )
    # The manual's examples, which users copy, have these wrong paths.
    @routes.put(base + "/{node}/parameters/parameters", include_in_schema=False)
    @routes.put(base + "/{node}/services/parameters", include_in_schema=False)
    async def put_parameters(node: NodeName, request: Request) -> Any:
        return await _set_parameters(service, _current_name(node), await _read_assignments(request))

    @routes.get(
        base + "/{node}/parameters/{name}", summary="A parameter", responses=PARAMETER_RESPONSE | node_errors(404)
    )
    async def parameter(node: NodeName, name: ParameterName) -> Any:
        return _describe(service, _current_name(node), [name])[0]

    @routes.put(
        base + "/{node}/parameters/{name}",
        summary="Set a parameter",
        responses=PARAMETER_RESPONSE | node_errors(400, 404, 413, 507),
        openapi_extra=VALUE_BODY,
    )
    async def put_parameter(node: NodeName, name: ParameterName, request: Request) -> Any:
        value = await _read_value(request)
        return (await _set_parameters(service, _current_name(node), [(name, value)]))[0]


def _add_service_routes(routes: APIRouter, base: str, service: StereoService) -> None:
    @routes.get(base + "/{node}/services", summary="Services of a node", responses=SERVICES_RESPONSE | node_errors(404))
    async def services(node: NodeName) -> Any:
        name = _current_name(node)
        return [device.service_info(name, service_name) for service_name in device.SERVICES[name]]

    @routes.get(base + "/{node}/services/{name}", summary="A service", responses=SERVICE_RESPONSE | node_errors(404))
    async def service_info(node: NodeName, name: ServiceName) -> Any:
        return device.service_info(*_find_service(node, name))

    @routes.put(
        base + "/{node}/services/{name}",
        summary="Call a service",
        responses=CALL_RESPONSE | node_errors(400, 404, 413, 507),
        openapi_extra=CALL_BODY,
    )
    async def call(node: NodeName, name: ServiceName, request: Request) -> Any:
        body = await read_body(request, MAX_BODY)
        content: _CallBody = decode(_CallBody, body or b"{}", '{"args": {}}')
        result = await device.call_service(service, *_find_service(node, name), content.args or {})
        await wait_until_stored(service)
        return result


def _current_name(node: str) -> str:
    """Return the name of a node in current firmware for a current or older name. Raises RestError."""
    node = NODE_ALIASES.get(node, node)
    if node not in NODES:
        raise RestError(404, f"there is no node {node[:80]!r}; there are {', '.join(NODES)}")
    return node


def _find_service(node: str, name: str) -> tuple[str, str]:
    """Return the current name of a node and the name of its service. Raises RestError."""
    node = _current_name(node)
    if name not in device.SERVICES[node]:
        raise RestError(404, f"{node} has no service {name[:80]!r}")
    return node, name


def _describe(service: StereoService, node: str, names: list[str]) -> list[dict[str, Any]]:
    """Return descriptions of the named parameters, or of all parameters if ``names`` is empty."""
    return [service.parameters.describe(node, name) for name in names or NODES[node]]


async def _set_parameters(service: StereoService, node: str, values: list[tuple[str, object]]) -> list[dict[str, Any]]:
    names = service.set_parameters(node, values)
    await wait_until_stored(service)
    return _describe(service, node, names)


async def wait_until_stored(service: StereoService) -> None:
    """Wait until the parameters are stored; raises RestError."""
    problem = await service.wait_until_stored() if service.wait_until_stored is not None else ""
    if problem:
        raise RestError(507, f"the values are set, but could not be stored: {problem}")


async def _read_assignments(request: Request) -> list[tuple[str, object]]:
    """Return the parameter names and values in the query, followed by those in the body. Either may be empty."""
    body = await read_body(request, MAX_BODY)
    values: list[tuple[str, object]] = [(name, _query_value(text)) for name, text in request.query_params.multi_items()]
    if body:
        entries: list[_Assignment] = decode(list[_Assignment], body, '[{"name": "quality", "value": "High"}]')
        values += [(entry.name, entry.value) for entry in entries]
    return values


async def _read_value(request: Request) -> object:
    """Return the value in the body, or in the query if there is no body."""
    body = await read_body(request, MAX_BODY)
    if not body and "value" in request.query_params:
        return _query_value(request.query_params["value"])
    content: _ValueBody = decode(_ValueBody, body, '{"value": 1.0}')
    return content.value


def _query_value(text: str) -> object:
    """Return a query value as a boolean or number if it is one, else as text."""
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    try:
        return float(text) if len(text) < NUMBER_TEXT_LIMIT else text
    except ValueError:
        return text


def decode(content: Any, body: bytes, example: str) -> Any:
    """Return a body as an object of the type ``content``; raises RestError."""
    try:
        return msgspec.json.decode(body, type=content)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise RestError(400, f"the body is not like {example}: {error}") from None
    except RecursionError:
        raise RestError(400, f"the body is not like {example}: it is nested too deep") from None
