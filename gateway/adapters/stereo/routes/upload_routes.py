"""REST routes of the device's undocumented test mode: show an uploaded stereo pair in place of the scene."""

from __future__ import annotations

from collections.abc import AsyncGenerator
from typing import Any, Final

from fastapi import APIRouter, Request
from python_multipart.multipart import parse_options_header
from starlette.datastructures import FormData, Headers, UploadFile
from starlette.formparsers import MultiPartException, MultiPartParser

from gateway.adapters.stereo.imaging.recorded_pairs import (
    MAX_FOCAL_FACTOR,
    Pair,
    PairImaging,
    PairSequence,
    pair_imaging,
)
from gateway.adapters.stereo.routes.rest_common import RestError, error_responses, new_router
from gateway.adapters.stereo.service import StereoService
from gateway.runtime.http.openapi import BINARY, json_example
from renderers.drawlist import ImageError

MAX_CONTENT_TYPE: Final = 1024
"""Maximum number of characters of the header Content-Type; a boundary has at most 70 (RFC 2046, 5.1.1)."""
_LOW_FIELDS: Final = ("left_out1_low", "right_out1_low")
_HIGH_FIELDS: Final = ("left_out1_high", "right_out1_high")
_SUCCESS: Final = {"return_code": {"value": 0, "message": ""}}
_ERROR_RESPONSES: Final = error_responses(
    {
        400: "The form has no valid stereo pair; the message is the reason.",
        413: "The form is too large.",
        503: "Too many requests wait already; see Retry-After.",
    }
)
_FORM_SCHEMA: Final = {
    "type": "object",
    "required": list(_LOW_FIELDS),
    "additionalProperties": False,
    "properties": {
        "left_out1_low": {
            **BINARY,
            "description": "Left image with Out1 low: PNG, JPEG or WebP, rectified, 16 to 8192 pixels a side.",
        },
        "right_out1_low": {**BINARY, "description": "Right image with Out1 low, of the same size."},
        "left_out1_high": {
            **BINARY,
            "description": "Left image with Out1 high; by default that with Out1 low.",
        },
        "right_out1_high": {**BINARY, "description": "Right image with Out1 high."},
        "f": {
            "type": "number",
            "minimum": 0.05,
            "maximum": MAX_FOCAL_FACTOR * 8192,
            "description": f"Focal length in pixels, or divided by the image's width when below {MAX_FOCAL_FACTOR:g}; "
            "by default the camera's.",
        },
        "t": {
            "type": "number",
            "minimum": 1e-4,
            "maximum": 100,
            "description": "Baseline in metres; by default the camera's.",
        },
    },
    "dependentRequired": {_HIGH_FIELDS[0]: [_HIGH_FIELDS[1]], _HIGH_FIELDS[1]: [_HIGH_FIELDS[0]]},
}
_BODY: Final = {
    "requestBody": {
        "required": True,
        "description": "curl -F left_out1_low=@left.png -F right_out1_low=@right.png -F f=0.8449 -F t=0.16 URL",
        "content": {
            "multipart/form-data": {
                "schema": _FORM_SCHEMA,
                "encoding": {
                    name: {"contentType": "image/png, image/jpeg, image/webp"} for name in (*_LOW_FIELDS, *_HIGH_FIELDS)
                },
            }
        },
    }
}


def upload_router(*services: StereoService) -> APIRouter:
    """Return the routes ``/api/v2/pipelines/N/test/set``: ``POST`` shows a pair, ``DELETE`` the scene."""
    routes = new_router()
    for number, service in enumerate(services):
        _add_routes(routes, f"/api/v2/pipelines/{number}/test/set", service)
    return routes


def _add_routes(routes: APIRouter, path: str, service: StereoService) -> None:
    @routes.post(
        path, summary="Show a stereo pair", responses=json_example(_SUCCESS) | _ERROR_RESPONSES, openapi_extra=_BODY
    )
    async def show_pair(request: Request) -> Any:
        try:
            form = await _read_form(request, service.config.max_upload)
            try:
                service.show_pairs(await _read_pair(service, form))
            finally:
                await form.close()
        except (ValueError, ImageError, MultiPartException) as error:
            raise RestError(400, str(error)) from None
        return _SUCCESS

    @routes.delete(path, summary="Show the scene again", responses=json_example(_SUCCESS))
    async def show_scene() -> Any:
        service.show_pairs(None)
        return _SUCCESS


async def _read_form(request: Request, limit: int) -> FormData:
    """Return the form.

    Raises:
        RestError: the body has more than ``limit`` bytes.
        ValueError: wrong content type.
        MultiPartException: malformed form.
    """
    content_type = request.headers.get("content-type", "")
    if len(content_type) > MAX_CONTENT_TYPE:
        raise ValueError(f"Content-Type has {len(content_type)} characters, the limit is {MAX_CONTENT_TYPE}")
    media_type, options = parse_options_header(content_type)
    if media_type != b"multipart/form-data" or not options.get(b"boundary"):
        raise ValueError(f"the content type is {content_type[:80]!r}, multipart/form-data with a boundary is needed")
    # Drop all options but the boundary: a charset chosen by the client may take minutes to decode (idna).
    boundary = options[b"boundary"].replace(b"\\", b"\\\\").replace(b'"', b'\\"')
    headers = Headers(raw=[(b"content-type", b'multipart/form-data; boundary="' + boundary + b'"')])

    async def limited_stream() -> AsyncGenerator[bytes, None]:
        size = 0
        async for chunk in request.stream():
            size += len(chunk)
            if size > limit:
                raise RestError(413, f"the form is larger than {limit} bytes")
            yield chunk

    return await MultiPartParser(headers, limited_stream(), max_files=4, max_fields=8).parse()


async def _read_pair(service: StereoService, form: FormData) -> PairImaging:
    """Return the pair of a form.

    Raises:
        ValueError: missing or invalid field.
        ImageError: an image cannot be decoded.
    """
    low, high = await _read_files(form, _LOW_FIELDS), await _read_files(form, _HIGH_FIELDS)
    if len(low) < 2:
        raise ValueError("the form needs the files left_out1_low and right_out1_low")
    if len(high) == 1:
        raise ValueError("left_out1_high and right_out1_high need each other")
    config = service.scene_imaging.config
    pair = Pair((low[0], low[1]), (high[0], high[1]) if high else None)
    focal = _read_number(form, "f", config.model.focal_factor)
    baseline = _read_number(form, "t", config.model.baseline)
    pairs = PairSequence([pair], config.max_pair_pixels)
    return await service.workers.run(pair_imaging, service.scene_imaging, pairs, focal, baseline)


async def _read_files(form: FormData, names: tuple[str, ...]) -> list[bytes]:
    """Return the contents of the named fields that are files."""
    files = (form.get(name) for name in names)
    return [await file.read() for file in files if isinstance(file, UploadFile)]


def _read_number(form: FormData, name: str, default: float) -> float:
    value = form.get(name)
    if value is None or value == "":
        return default
    try:
        return float(value) if isinstance(value, str) and len(value) < 64 else float("nan")
    except ValueError:
        raise ValueError(f"{name}: {str(value)[:80]!r} is not a number") from None
