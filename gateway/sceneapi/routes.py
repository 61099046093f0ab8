"""``GET /scene``, ``GET /scene.glb`` and ``GET /scene/render``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final

from fastapi import APIRouter, Request, Response

from gateway.scene.live import Snapshot
from gateway.scene.timeline import TimeError
from gateway.sceneapi.query import (
    TIME_PARAMETER,
    CameraNotFoundError,
    QueryError,
    openapi_file_parameters,
    openapi_parameters,
    parse_file_query,
    parse_query,
    parse_time,
)
from gateway.sceneapi.service import SceneApi, SceneResponse
from gateway.server.disconnect import while_connected
from gateway.server.plain_error_route import PlainErrorRoute

_TEXT: Final = {"text/plain": {"schema": {"type": "string"}}}
_INVALID_PARAMETER: Final = {"description": "A parameter is invalid; the text says why.", "content": _TEXT}
_CAMERA_NOT_FOUND: Final = {
    "description": "The camera's node is not in the scene, there is no stereo camera, or no state of this time.",
    "content": _TEXT,
}
_LISTING_EXAMPLE: Final = {
    "revision": 7,
    "nodes": [
        {
            "path": ["robot", "head"],
            "kinds": ["box"],
            "has_geometry": True,
            "visible": True,
            "opacity": 1.0,
            "label": 1,
            "bounds": [[-0.1, -0.1, 0.9], [0.1, 0.1, 1.1]],
            "transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]],
        }
    ],
    "node_count": 1,
    "bounds": [[-0.1, -0.1, 0.9], [0.1, 0.1, 1.1]],
}
_BINARY: Final = {"schema": {"type": "string", "format": "binary"}}


class _SceneRoute(PlainErrorRoute):
    statuses: ClassVar[Mapping[type[Exception], int]] = {
        CameraNotFoundError: 404,
        TimeError: 404,
        QueryError: 400,
        **PlainErrorRoute.statuses,
    }


def router(service: SceneApi) -> APIRouter:
    """Return the routes of the scene."""
    routes = APIRouter(tags=["The live scene"], route_class=_SceneRoute)

    async def listing(request: Request) -> Response:
        """Every node with its kinds of geometry, world transform, bounds and label. Parents come before children."""
        snapshot = await service.snapshot_at(parse_time(request.query_params))
        return await _cacheable(service, request, service.listing, snapshot)

    async def file(request: Request) -> Response:
        """The scene as one binary glTF file: Y up, textures embedded, hidden nodes left out."""
        query = parse_file_query(dict(request.query_params), service.config)
        snapshot = await service.snapshot_at(parse_time(request.query_params))
        if query is None:
            return await _cacheable(service, request, lambda snapshot: service.file(None, snapshot), snapshot)
        return await _uncacheable(service, request, lambda: service.file(query, snapshot))

    async def image(request: Request) -> Response:
        """An image of the newest scene, or of an earlier one."""
        query = parse_query(dict(request.query_params), service.config)
        snapshot = await service.snapshot_at(parse_time(request.query_params))
        return await _uncacheable(service, request, lambda: service.image(query, snapshot))

    routes.add_api_route(
        "/scene",
        listing,
        methods=["GET"],
        summary="List the scene",
        response_class=Response,
        responses={
            **_responses({"application/json": {"example": _LISTING_EXAMPLE}}, cached=True),
            400: _INVALID_PARAMETER,
            404: {"description": "There is no state of this time.", "content": _TEXT},
        },
        openapi_extra={"parameters": [TIME_PARAMETER.openapi()]},
    )
    routes.add_api_route(
        "/scene.glb",
        file,
        methods=["GET"],
        summary="Download the scene",
        response_class=Response,
        responses={
            **_responses({"model/gltf-binary": _BINARY}, cached=True),
            400: _INVALID_PARAMETER,
            404: _CAMERA_NOT_FOUND,
            413: {"description": "The file would be larger than the limit.", "content": _TEXT},
        },
        openapi_extra={"parameters": openapi_file_parameters(service.config)},
    )
    routes.add_api_route(
        "/scene/render",
        image,
        methods=["GET"],
        summary="Render the scene",
        response_class=Response,
        responses=_responses({"image/png": _BINARY, "image/tiff": _BINARY}, cached=False),
        openapi_extra={"parameters": openapi_parameters(service.config)},
    )
    return routes


def _responses(content: dict[str, Any], *, cached: bool) -> dict[int | str, dict[str, Any]]:
    """Return the OpenAPI descriptions of a route's responses.

    Args:
        content: Media types of the 200 response.
        cached: True for a route that responds with ``_cacheable``.
    """
    responses: dict[int | str, dict[str, Any]] = {
        200: {"description": "The header X-Scene-Revision has the revision of the scene.", "content": content},
        503: {
            "description": "With Retry-After: too many requests wait. Without: rendering took too long.",
            "content": _TEXT,
        },
    }
    responses[500] = {"description": "A texture of the scene cannot be decoded.", "content": _TEXT}
    if cached:
        responses[304] = {"description": "The scene has not changed since If-None-Match."}
    else:
        responses[400], responses[404] = _INVALID_PARAMETER, _CAMERA_NOT_FOUND
    return responses


async def _cacheable(
    service: SceneApi,
    request: Request,
    make: Callable[[Snapshot | None], SceneResponse],
    snapshot: Snapshot | None,
) -> Response:
    """Return the result of ``make``, which depends only on the scene; 304 if the client has its revision."""
    headers = {"Cache-Control": "no-cache"}
    revision = (snapshot or service.snapshot).revision
    etag = service.etag(revision)
    client_etags = [tag.strip().removeprefix("W/") for tag in request.headers.get("if-none-match", "").split(",")]
    if etag in client_etags or "*" in client_etags:
        return Response(status_code=304, headers={**headers, "ETag": etag, "X-Scene-Revision": str(revision)})
    result = await while_connected(request, service.workers.run(make, snapshot))
    return _response(result, {**headers, "ETag": service.etag(result.revision)})


async def _uncacheable(service: SceneApi, request: Request, make: Callable[[], SceneResponse]) -> Response:
    """Return the result of ``make``, which depends on more than the scene, so that clients must not cache it."""
    result = await while_connected(request, service.workers.run(make))
    return _response(result, {"Cache-Control": "no-store"})


def _response(result: SceneResponse, headers: dict[str, str]) -> Response:
    headers["X-Scene-Revision"] = str(result.revision)
    return Response(result.body, media_type=result.media_type, headers=headers)
