"""``POST /render``: Drake's render endpoint on HTTP."""

from __future__ import annotations

from typing import Any, Final

from fastapi import APIRouter, Request, Response
from starlette.middleware.body_limit import RequestBodyLimitMiddleware
from starlette.routing import Route
from starlette.types import ASGIApp, Receive, Scope, Send

from gateway.render.exchange import Exchange
from gateway.render.service import RenderService

_NO_FRAMEWORK_LIMIT: Final = 1 << 62
"""The body is bounded here, with a sentence that says by what; the framework's own 413 would say less."""

_USAGE: Final = """\
This is Drake's glTF render endpoint. Send a POST with multipart/form-data, for instance

  curl -F scene=@scene.gltf -F image_type=color -F width=640 -F height=480 -F near=0.01 -F far=10 \\
       -F focal_x=579.4 -F focal_y=579.4 -F center_x=319.5 -F center_y=239.5 -o color.png {url}

or give Drake's MakeRenderEngineGltfClient this server's address.
"""


def _field(kind: str, default: object, text: str, **more: object) -> dict[str, Any]:
    return {"type": kind, "default": default, "description": text, **more}


_FORM: Final[dict[str, Any]] = {
    "type": "object",
    "required": ["scene", "image_type", "width", "height", "near", "far", "focal_x", "focal_y", "center_x", "center_y"],
    "properties": {
        "scene": {
            "type": "string",
            "format": "binary",
            "description": "glTF 2.0 (.gltf or .glb), everything embedded. Used as it is: Drake's world is Z-up.",
        },
        "image_type": _field("string", "color", "Which picture.", enum=["color", "depth", "label"]),
        "width": _field("integer", 640, "Pixels."),
        "height": _field("integer", 480, "Pixels."),
        "near": _field("number", 0.01, "Near clipping plane, metres; 0: the scene's camera's."),
        "far": _field("number", 10.0, "Far clipping plane, metres."),
        "focal_x": _field("number", 579.411, "Focal length, pixels."),
        "focal_y": _field("number", 579.411, "Focal length, pixels."),
        "center_x": _field("number", 319.5, "Principal point, pixels from the left edge."),
        "center_y": _field("number", 239.5, "Principal point, pixels from the top edge."),
        "min_depth": _field("number", 0.1, "Metres; nearer is 0. Needed for depth."),
        "max_depth": _field("number", 5.0, "Metres; farther is infinite. Needed for depth."),
        "fov_x": {"type": "number", "description": "Radians; used only where focal_x is missing."},
        "fov_y": {"type": "number", "description": "Radians; used only where focal_y is missing."},
        "scene_sha256": {"type": "string", "description": "64 hexadecimal digits; checked when it looks like a hash."},
        "submit": {"type": "string", "description": "Ignored; Drake's client sends Render."},
    },
}
_RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "The picture: colour and label as PNG (RGB, 8 bit), depth as TIFF (32-bit float, metres) or, as "
        "the operator chooses, PNG (16 bit, millimetres).",
        "content": {
            "image/png": {"schema": {"type": "string", "format": "binary"}},
            "image/tiff": {"schema": {"type": "string", "format": "binary"}},
        },
    },
    **{
        status: {"description": text, "content": {"text/plain": {"schema": {"type": "string"}}}}
        for status, text in {
            400: "The form, the scene or its camera cannot be used; the text names the field or glTF element and why.",
            408: "The upload stalled.",
            413: "The body is too large.",
            500: "A defect of the server; the text names the request's id.",
            503: "Too many requests wait already, see Retry-After; or, without it, the picture took too long.",
        }.items()
    },
}


def router(service: RenderService) -> APIRouter:
    """The routes of the render endpoint, at the path of the service's configuration."""
    routes = APIRouter(tags=["render"])
    path = service.config.path

    async def render(http: Request) -> Response:
        """Draws the posted glTF scene with the posted camera, as Drake's render engines do.

        The request is answered when the picture is ready; requests beyond the number of worker threads wait in line.
        """
        return await Exchange(service, http).answer()

    async def usage(http: Request) -> Response:
        text = _USAGE.format(url=http.url.replace(query="", fragment=""))
        return Response(text, 405, headers={"Allow": "POST"}, media_type="text/plain; charset=utf-8")

    routes.add_api_route(
        path,
        render,
        methods=["POST"],
        summary="Render a glTF scene",
        response_class=Response,
        responses=_RESPONSES,
        openapi_extra={"requestBody": {"required": True, "content": {"multipart/form-data": {"schema": _FORM}}}},
        max_body_size=_NO_FRAMEWORK_LIMIT,
    )
    routes.add_api_route(
        path,
        usage,
        methods=["GET", "HEAD", "PUT", "PATCH", "DELETE", "OPTIONS"],
        response_class=Response,
        include_in_schema=False,
    )
    return routes


def straight(service: RenderService) -> ASGIApp:
    """``POST`` of ``router``, for whoever has found out method and path."""

    async def render(scope: Scope, receive: Receive, send: Send) -> None:
        scope["route"] = route
        answer = await Exchange(service, Request(scope, receive, send)).answer()
        await answer(scope, receive, send)

    route = Route(service.config.path, render, methods=["POST"])
    return RequestBodyLimitMiddleware(render, _NO_FRAMEWORK_LIMIT)
