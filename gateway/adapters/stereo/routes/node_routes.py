"""REST routes of the device's nodes: parameters, status values and services."""

from __future__ import annotations

from typing import Any, Final

import msgspec
from fastapi import APIRouter, Request

from gateway.adapters.stereo.device.parameter_specs import NODE_ALIASES, NODES
from gateway.adapters.stereo.routes import device_content as device
from gateway.adapters.stereo.routes import node_schemas as schemas
from gateway.adapters.stereo.routes.node_schemas import (
    NodeName,
    ParameterName,
    ParameterNames,
    ServiceName,
    node_errors,
)
from gateway.adapters.stereo.routes.rest_common import RestError, new_router, read_body
from gateway.adapters.stereo.service import StereoService

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
    @routes.get(base, summary="Nodes", responses=schemas.NODES_RESPONSE)
    async def nodes() -> Any:
        return [device.node_info(name) for name in NODES]

    @routes.get(base + "/{node}", summary="A node", responses=schemas.NODE_RESPONSE | node_errors(404))
    async def node_info(node: NodeName) -> Any:
        return device.node_info(_current_name(node))

    @routes.get(
        base + "/{node}/status",
        summary="Status values of a node",
        responses=schemas.STATUS_RESPONSE | node_errors(404),
    )
    async def status(node: NodeName) -> Any:
        return device.node_status(service, _current_name(node))

    @routes.get(
        base + "/{node}/parameters",
        summary="Parameters of a node",
        responses=schemas.PARAMETERS_RESPONSE | node_errors(404),
    )
    async def parameters(node: NodeName, names: ParameterNames = []) -> Any:  # noqa: B006 - FastAPI copies it
        return _describe(service, _current_name(node), names)

    @routes.put(
        base + "/{node}/parameters",
        summary="Set parameters: all or none",
        responses=schemas.ASSIGNED_RESPONSE | node_errors(400, 404, 413, 507),
        openapi_extra=schemas.ASSIGNMENTS_BODY,
    )
    # The manual's examples, which users copy, have these wrong paths.
    @routes.put(base + "/{node}/parameters/parameters", include_in_schema=False)
    @routes.put(base + "/{node}/services/parameters", include_in_schema=False)
    async def put_parameters(node: NodeName, request: Request) -> Any:
        return await _set_parameters(service, _current_name(node), await _read_assignments(request))

    @routes.get(
        base + "/{node}/parameters/{name}",
        summary="A parameter",
        responses=schemas.PARAMETER_RESPONSE | node_errors(404),
    )
    async def parameter(node: NodeName, name: ParameterName) -> Any:
        return _describe(service, _current_name(node), [name])[0]

    @routes.put(
        base + "/{node}/parameters/{name}",
        summary="Set a parameter",
        responses=schemas.PARAMETER_RESPONSE | node_errors(400, 404, 413, 507),
        openapi_extra=schemas.VALUE_BODY,
    )
    async def put_parameter(node: NodeName, name: ParameterName, request: Request) -> Any:
        value = await _read_value(request)
        return (await _set_parameters(service, _current_name(node), [(name, value)]))[0]


def _add_service_routes(routes: APIRouter, base: str, service: StereoService) -> None:
    @routes.get(
        base + "/{node}/services",
        summary="Services of a node",
        responses=schemas.SERVICES_RESPONSE | node_errors(404),
    )
    async def services(node: NodeName) -> Any:
        name = _current_name(node)
        return [device.service_info(name, service_name) for service_name in device.SERVICES[name]]

    @routes.get(
        base + "/{node}/services/{name}",
        summary="A service",
        responses=schemas.SERVICE_RESPONSE | node_errors(404),
    )
    async def service_info(node: NodeName, name: ServiceName) -> Any:
        return device.service_info(*_find_service(node, name))

    @routes.put(
        base + "/{node}/services/{name}",
        summary="Call a service",
        responses=schemas.CALL_RESPONSE | node_errors(400, 404, 413, 507),
        openapi_extra=schemas.CALL_BODY,
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
