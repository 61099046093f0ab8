"""``GET /scene``, ``GET /scene.glb`` and ``GET /scene/render``."""

from collections.abc import Callable, Mapping
from typing import Annotated, ClassVar, Final

from fastapi import APIRouter, Query, Request, Response

from gateway.adapters.sceneapi.query import FileQuery, ImageQuery, SceneQuery
from gateway.adapters.sceneapi.service import SceneApi, SceneResponse
from gateway.runtime.http.disconnect import while_connected
from gateway.runtime.http.openapi import Responses, error_responses, file_response, json_example
from gateway.runtime.http.plain_error_route import PlainErrorRoute
from gateway.scene.draw.cameras import CameraError, NoSuchCameraError
from gateway.scene.tree.live import Snapshot
from gateway.scene.tree.timeline import TimeError, state_at

_UNAVAILABLE: Final = {
    500: "A texture of the scene cannot be decoded.",
    503: "With Retry-After: too many requests wait. Without: rendering took too long.",
}
_CAMERA_ERRORS: Final = {
    400: "The camera cannot be used in the scene.",
    404: "The camera's node is not in the scene, there is no stereo camera, or no state of this time.",
    **_UNAVAILABLE,
}
_REVISION: Final = "The header X-Scene-Revision has the revision of the scene."
_UNCHANGED: Final[Responses] = {304: {"description": "The scene has not changed since If-None-Match."}}
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


class _SceneRoute(PlainErrorRoute):
    statuses: ClassVar[Mapping[type[Exception], int]] = {
        NoSuchCameraError: 404,
        TimeError: 404,
        CameraError: 400,
        **PlainErrorRoute.statuses,
    }


def router(service: SceneApi) -> APIRouter:
    """Return the routes of the scene."""
    routes = APIRouter(tags=["The live scene"], route_class=_SceneRoute)

    async def snapshot_at(time: float | None) -> Snapshot | None:
        """Return the snapshot of a time; None: the newest one when the response is made."""
        return None if time is None else await state_at(service.scene.timeline, time)

    def revision_of(snapshot: Snapshot | None) -> int:
        return (snapshot or service.scene.tree.snapshot).revision

    @routes.get(
        "/scene",
        summary="List the scene",
        response_class=Response,
        responses={
            **json_example(_LISTING_EXAMPLE, _REVISION),
            **_UNCHANGED,
            **error_responses({404: "There is no state of this time.", **_UNAVAILABLE}),
        },
    )
    async def listing(request: Request, query: Annotated[SceneQuery, Query()]) -> Response:
        """Every node with its kinds of geometry, world transform, bounds and label. Parents come before children."""
        snapshot = await snapshot_at(query.time)
        return await _respond(service, request, lambda: service.listing(snapshot), revision_of(snapshot))

    @routes.get(
        "/scene.glb",
        summary="Download the scene",
        response_class=Response,
        responses={
            **file_response(_REVISION, "model/gltf-binary"),
            **_UNCHANGED,
            **error_responses({**_CAMERA_ERRORS, 413: "The file would be larger than the limit."}),
        },
    )
    async def file(request: Request, query: Annotated[FileQuery, Query()]) -> Response:
        """The scene as one binary glTF file: Y up, textures embedded, hidden nodes left out.

        Clients of the render endpoint need the camera in the file; without any parameter it has none.
        """
        snapshot = await snapshot_at(query.time)
        if query.model_fields_set <= {"time"}:
            return await _respond(service, request, lambda: service.file(None, snapshot), revision_of(snapshot))
        return await _respond(service, request, lambda: service.file(query, snapshot))

    @routes.get(
        "/scene/render",
        summary="Render the scene",
        response_class=Response,
        responses={**file_response(_REVISION, "image/png", "image/tiff"), **error_responses(_CAMERA_ERRORS)},
    )
    async def image(request: Request, query: Annotated[ImageQuery, Query()]) -> Response:
        """An image of the newest scene, or of an earlier one."""
        snapshot = await snapshot_at(query.time)
        return await _respond(service, request, lambda: service.image(query, snapshot))

    return routes


async def _respond(
    service: SceneApi, request: Request, make: Callable[[], SceneResponse], revision: int | None = None
) -> Response:
    """Return the result of ``make``.

    ``revision``: that of the scene, if the result depends on nothing else: clients that have it get status 304.
    """
    if revision is not None:
        etag = service.etag(revision)
        client_etags = [tag.strip().removeprefix("W/") for tag in request.headers.get("if-none-match", "").split(",")]
        if etag in client_etags or "*" in client_etags:
            headers = {"Cache-Control": "no-cache", "ETag": etag, "X-Scene-Revision": str(revision)}
            return Response(status_code=304, headers=headers)
    result = await while_connected(request, service.workers.run(make))
    headers = {"Cache-Control": "no-store", "X-Scene-Revision": str(result.revision)}
    if revision is not None:
        headers |= {"Cache-Control": "no-cache", "ETag": service.etag(result.revision)}
    return Response(result.body, media_type=result.media_type, headers=headers)
