"""``GET /scene``, ``GET /scene.glb`` and ``GET /scene/render``."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from fastapi import APIRouter, Request, Response
from starlette.requests import ClientDisconnect

from gateway.gltf.export import ExportError
from gateway.runtime.worker_pool import DeadlineExceeded, PoolClosed, QueueFull
from gateway.sceneapi.query import (
    NoSuchCameraQueryError,
    QueryError,
    openapi_file_parameters,
    openapi_parameters,
    parse_file_query,
    parse_query,
)
from gateway.sceneapi.service import Answer, SceneApi
from gateway.server.disconnect import CLIENT_GONE, while_connected
from renderers.drawlist import ImageError

_TEXT: Final = {"text/plain": {"schema": {"type": "string"}}}
_UNUSABLE: Final = {"description": "A parameter cannot be used; the text names it and why.", "content": _TEXT}
_NO_CAMERA: Final = {
    "description": "The camera's node is not in the scene, or there is no stereo camera.",
    "content": _TEXT,
}
_LISTING: Final = {
    "revision": 7,
    "nodes": [
        {
            "path": ["robot", "head"],
            "kinds": ["box"],
            "has_geometry": True,
            "visible": True,
            "label": 1,
            "bounds": [[-0.1, -0.1, 0.9], [0.1, 0.1, 1.1]],
            "transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]],
        }
    ],
    "node_count": 1,
    "bounds": [[-0.1, -0.1, 0.9], [0.1, 0.1, 1.1]],
}
_BINARY: Final = {"schema": {"type": "string", "format": "binary"}}


def router(service: SceneApi) -> APIRouter:
    """The routes of the scene."""
    routes = APIRouter(tags=["scene"])

    async def listing(http: Request) -> Response:
        """All nodes with their kinds, world transforms, bounds and labels, parents before children."""
        return await _state(service, http, service.listing)

    async def file(http: Request) -> Response:
        """The scene as one binary glTF file: Y up, textures embedded, hidden nodes left out."""
        try:
            query = parse_file_query(dict(http.query_params), service.config)
        except QueryError as error:
            return _plain(400, str(error))
        if query is None:
            return await _state(service, http, service.file)
        return await _now(service, http, lambda: service.file(query))

    async def picture(http: Request) -> Response:
        """A picture of the scene as it is now."""
        try:
            query = parse_query(dict(http.query_params), service.config)
        except QueryError as error:
            return _plain(400, str(error))
        return await _now(service, http, lambda: service.picture(query))

    routes.add_api_route(
        "/scene",
        listing,
        methods=["GET"],
        summary="List the scene",
        response_class=Response,
        responses=_responses({"application/json": {"example": _LISTING}}, cached=True),
    )
    routes.add_api_route(
        "/scene.glb",
        file,
        methods=["GET"],
        summary="Download the scene",
        response_class=Response,
        responses={**_responses({"model/gltf-binary": _BINARY}, cached=True), 400: _UNUSABLE, 404: _NO_CAMERA},
        openapi_extra={"parameters": openapi_file_parameters(service.config)},
    )
    routes.add_api_route(
        "/scene/render",
        picture,
        methods=["GET"],
        summary="Render the scene",
        response_class=Response,
        responses=_responses({"image/png": _BINARY, "image/tiff": _BINARY}, cached=False),
        openapi_extra={"parameters": openapi_parameters(service.config)},
    )
    return routes


def _responses(content: dict[str, Any], *, cached: bool) -> dict[int | str, dict[str, Any]]:
    answers: dict[int | str, dict[str, Any]] = {
        200: {"description": "The header X-Scene-Revision tells which state of the scene it is.", "content": content},
        503: {
            "description": "Too many requests wait already, see Retry-After; or, without it, the answer took too long.",
            "content": _TEXT,
        },
    }
    answers[500] = {"description": "The scene holds a texture that cannot be drawn.", "content": _TEXT}
    if cached:
        answers[413] = {"description": "The file would be larger than the limit.", "content": _TEXT}
        answers[304] = {"description": "The scene is still that of If-None-Match."}
    else:
        answers[400], answers[404] = _UNUSABLE, _NO_CAMERA
    return answers


async def _state(service: SceneApi, http: Request, make: Callable[[], Answer]) -> Response:
    """An answer that depends on the scene only: 304 when the client has it already."""
    headers = {"Cache-Control": "no-cache"}
    revision = service.snapshot.revision
    etag = service.etag(revision)
    known = [tag.strip().removeprefix("W/") for tag in http.headers.get("if-none-match", "").split(",")]
    if etag in known or "*" in known:
        return Response(status_code=304, headers={**headers, "ETag": etag, "X-Scene-Revision": str(revision)})
    answer = await _made(service, http, make)
    if not isinstance(answer, Answer):
        return answer
    return _response(answer, {**headers, "ETag": service.etag(answer.revision)})


async def _now(service: SceneApi, http: Request, make: Callable[[], Answer]) -> Response:
    """An answer that depends on more than the scene."""
    answer = await _made(service, http, make)
    return _response(answer, {"Cache-Control": "no-store"}) if isinstance(answer, Answer) else answer


async def _made(service: SceneApi, http: Request, make: Callable[[], Answer]) -> Answer | Response:
    """The answer, made in a worker thread; or the refusal."""
    try:
        return await while_connected(http, service.workers.run(make))
    except ClientDisconnect:
        return Response(status_code=CLIENT_GONE)
    except NoSuchCameraQueryError as error:
        return _plain(404, str(error))
    except QueryError as error:
        return _plain(400, str(error))
    except ExportError as error:
        return _plain(413, str(error))
    except ImageError as error:
        return _plain(500, f"the scene holds a texture that cannot be drawn: {error}")
    except QueueFull as busy:
        return _plain(503, str(busy), {"Retry-After": str(busy.retry_after)})
    except PoolClosed as closed:
        return _plain(503, str(closed), {"Retry-After": "1"})
    except DeadlineExceeded as error:
        return _plain(503, f"the answer was given up: {error}")


def _response(answer: Answer, headers: dict[str, str]) -> Response:
    headers["X-Scene-Revision"] = str(answer.revision)
    return Response(answer.body, media_type=answer.media_type, headers=headers)


def _plain(status: int, sentence: str, headers: dict[str, str] | None = None) -> Response:
    text = sentence.encode("utf-8", "backslashreplace")
    return Response(text, status, headers=headers, media_type="text/plain; charset=utf-8")
