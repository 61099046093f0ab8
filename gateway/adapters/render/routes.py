"""``POST /render``: Drake's render endpoint on HTTP."""

import json
import math
from typing import Any, Final

from fastapi import APIRouter, Request, Response
from fastapi.routing import APIRoute
from starlette.types import Receive, Scope, Send

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.form import IMAGE_TYPES, LOOK_FIELD, LOOKS
from gateway.adapters.render.request import MAX_FAR, MAX_FOCAL, MAX_FOV, MIN_FAR, MIN_FOV
from gateway.adapters.render.service import RenderService
from gateway.runtime.http.openapi import error_responses, example, file_response

_USAGE: Final = """\
This is Drake's glTF render endpoint. Send a POST with multipart/form-data, for instance

  curl -F scene=@scene.gltf -F image_type=color -F width=640 -F height=480 -F near=0.01 -F far=10 \\
       -F focal_x=579.4 -F focal_y=579.4 -F center_x=319.5 -F center_y=239.5 -o color.png {url}

or give Drake's MakeRenderEngineGltfClient this server's address.
"""
_DESCRIPTION: Final = """\
Render the posted glTF scene with the posted camera, as Drake's render engines do.

Requests beyond the number of worker threads wait in a queue.
"""
_SMALLEST_SCENE: Final = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"camera": 0}],
    "cameras": [{"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01, "zfar": 10.0}}],
}
"""Smallest scene that can be rendered: only a camera."""
_EXAMPLE_FORM: Final = {
    "scene": json.dumps(_SMALLEST_SCENE),
    "image_type": "color",
    "width": 640,
    "height": 480,
    "near": 0.01,
    "far": 10.0,
    "focal_x": 579.411,
    "focal_y": 579.411,
    "center_x": 319.5,
    "center_y": 239.5,
}
_RESPONSES: Final = {
    **file_response(
        "The image: colour and label as PNG (RGB, 8 bit), depth as TIFF (32-bit float, metres) or, as configured, PNG "
        "(16 bit, millimetres).",
        "image/png",
        "image/tiff",
    ),
    **error_responses(
        {
            400: "The form, the scene or its camera is invalid; the text names the field or glTF element and why.",
            408: "The upload stalled.",
            413: "The body is too large.",
            415: "The form is compressed (Content-Encoding).",
            500: "Internal error; the text has the request's id.",
            503: "The queue is full (with Retry-After), or rendering took too long (without).",
        }
    ),
}


def _field(json_type: str, description: str, **limits: object) -> dict[str, Any]:
    return {"type": json_type, "description": description, **limits}


def _openapi_extra(config: RenderConfig) -> dict[str, Any]:
    """Return the OpenAPI description of the form that ``FormReader`` accepts."""
    positive: dict[str, Any] = {"exclusiveMinimum": 0}
    side: dict[str, Any] = {"minimum": 1, "maximum": config.max_side}
    focal: dict[str, Any] = {"minimum": 1.0 / MAX_FOCAL, "maximum": MAX_FOCAL}
    angle: dict[str, Any] = {**positive, "exclusiveMaximum": math.pi}
    text: dict[str, Any] = {"maxLength": config.max_field_bytes}
    form: dict[str, Any] = {
        "type": "object",
        "description": "Unknown fields are ignored, with a warning in the server's log.",
        "maxProperties": config.max_parts,
        "propertyNames": {"minLength": 1},
        "required": ["scene", "image_type", "width", "height", "near", "far", "center_x", "center_y"],
        "properties": {
            "scene": _field(
                "string",
                "glTF 2.0 (.gltf or .glb) with all data embedded. Its axes are not converted: Drake's world is Z-up.",
                format="binary",
            ),
            "image_type": _field("string", "Kind of image.", enum=list(IMAGE_TYPES)),
            "width": _field("integer", f"Pixels; width x height is at most {config.max_pixels}.", **side),
            "height": _field("integer", "Pixels.", **side),
            "near": _field("number", "Near clipping plane, metres; 0 for the one of the scene's camera.", minimum=0),
            "far": _field("number", "Far clipping plane, metres; greater than near.", minimum=MIN_FAR, maximum=MAX_FAR),
            "focal_x": _field("number", "Focal length, pixels. Optional if fov_x is given.", **focal),
            "focal_y": _field("number", "Focal length, pixels. Optional if fov_y is given.", **focal),
            "center_x": _field("number", "Principal point, pixels from the left edge; less than width.", **positive),
            "center_y": _field("number", "Principal point, pixels from the top edge; less than height.", **positive),
            "min_depth": _field("number", "Metres; closer depths are 0. Required for depth.", minimum=0),
            "max_depth": _field(
                "number", "Metres, greater than min_depth; larger depths are infinite. Required for depth.", **positive
            ),
            "fov_x": _field("number", "Radians; used only if focal_x is missing.", **angle),
            "fov_y": _field("number", "Radians; used only if focal_y is missing.", **angle),
            "scene_sha256": _field("string", "SHA-256 of the scene, in hexadecimal; other text is ignored.", **text),
            LOOK_FIELD: _field("string", f"Shading; default: {config.style.look} (--look).", enum=list(LOOKS)),
            "submit": _field("string", "Ignored; Drake's client sends Render.", **text),
        },
        "allOf": [
            _focal_or_angle("x"),
            _focal_or_angle("y"),
            {
                "anyOf": [
                    {"properties": {"image_type": {"enum": [name for name in IMAGE_TYPES if name != "depth"]}}},
                    {"required": ["min_depth", "max_depth"]},
                ]
            },
        ],
    }
    for name, value in {**_EXAMPLE_FORM, "min_depth": 0.1, "max_depth": 5.0}.items():
        if name != "scene":
            form["properties"][name]["default"] = value  # Swagger UI fills the form with it
    content = {
        "schema": form,
        "examples": example(_EXAMPLE_FORM),
        "encoding": {"scene": {"contentType": "model/gltf-binary, model/gltf+json"}},
    }
    return {"requestBody": {"required": True, "content": {"multipart/form-data": content}}}


def _focal_or_angle(axis: str) -> dict[str, Any]:
    """Return the schema of a focal length, or else a field of view whose focal length is in range."""
    fov = f"fov_{axis}"
    limits = {"properties": {fov: {"minimum": MIN_FOV, "maximum": MAX_FOV}}}
    return {"anyOf": [{"required": [f"focal_{axis}"]}, {"required": [fov], **limits}]}


class _RequestRoute(APIRoute):
    """A route whose endpoint gets the request, without FastAPI's search for parameters and its checks of the result.

    FastAPI's own way from a route to its endpoint takes a tenth of the event loop's time for a request.
    """

    async def handle(self, scope: Scope, receive: Receive, send: Send) -> None:
        if self.methods is not None and scope["method"] not in self.methods:
            await super().handle(scope, receive, send)  # refuses it
            return
        response: Response = await self.endpoint(Request(scope, receive, send))
        await response(scope, receive, send)


def render_router(service: RenderService) -> APIRouter:
    """Return the routes of the render endpoint, at the path of its configuration."""
    router = APIRouter(route_class=_RequestRoute)
    path = service.config.path

    async def usage(request: Request) -> Response:
        text = _USAGE.format(url=request.url.replace(query="", fragment=""))
        return Response(text, 405, headers={"Allow": "POST"}, media_type="text/plain; charset=utf-8")

    router.add_api_route(
        path,
        service.respond,
        methods=["POST"],
        tags=["Render"],
        name="render",
        summary="Render a glTF scene",
        description=_DESCRIPTION,
        response_class=Response,
        responses=_RESPONSES,
        openapi_extra=_openapi_extra(service.config),
    )
    router.add_api_route(
        path,
        usage,
        methods=["GET", "HEAD", "PUT", "PATCH", "DELETE", "OPTIONS"],
        response_class=Response,
        include_in_schema=False,
    )
    return router
