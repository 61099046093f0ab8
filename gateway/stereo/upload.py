"""The device's undocumented test mode: show an uploaded stereo pair in place of the scene."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any, Final

from fastapi import APIRouter, Request
from fastapi.responses import JSONResponse
from python_multipart.multipart import parse_options_header
from starlette.datastructures import FormData, Headers, UploadFile
from starlette.formparsers import MultiPartException, MultiPartParser

from gateway.runtime.worker_pool import DeadlineExceeded, PoolClosed, QueueFull
from gateway.server.openapi import json_example
from gateway.stereo.pairs import FACTOR_LIMIT, Pair, PairImaging, Pairs, pair_imaging
from gateway.stereo.rest_errors import RestError
from gateway.stereo.service import StereoService
from renderers.drawlist import ImageError

MAX_CONTENT_TYPE: Final = 1024
"""Maximum number of characters of the header; a boundary has at most 70 (RFC 2046, 5.1.1)."""
_LOW = ("left_out1_low", "right_out1_low")
_HIGH = ("left_out1_high", "right_out1_high")
_DONE: Final = {"return_code": {"value": 0, "message": ""}}
_MESSAGE: Final = {"application/json": {"schema": {"type": "object", "properties": {"message": {"type": "string"}}}}}
_ERROR_RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    400: {"description": "The form has no valid stereo pair; the message is the reason.", "content": _MESSAGE},
    413: {"description": "The form is too large.", "content": _MESSAGE},
    503: {"description": "Too many requests wait already; see Retry-After.", "content": dict(_MESSAGE)},
}
_IMAGE: Final = {"type": "string", "format": "binary"}
_FORM: Final = {
    "type": "object",
    "required": list(_LOW),
    "additionalProperties": False,
    "properties": {
        "left_out1_low": {
            **_IMAGE,
            "description": "Left image with Out1 low: PNG, JPEG or WebP, rectified, 16 to 8192 pixels a side.",
        },
        "right_out1_low": {**_IMAGE, "description": "Right image with Out1 low, of the same size."},
        "left_out1_high": {**_IMAGE, "description": "Left image with Out1 high; by default the one with Out1 low."},
        "right_out1_high": {**_IMAGE, "description": "Right image with Out1 high."},
        "f": {
            "type": "number",
            "minimum": 0.05,
            "maximum": FACTOR_LIMIT * 8192,
            "description": f"Focal length in pixels, or divided by the image's width when below {FACTOR_LIMIT:g}; "
            "by default the camera's.",
        },
        "t": {
            "type": "number",
            "minimum": 1e-4,
            "maximum": 100,
            "description": "Baseline in metres; by default the camera's.",
        },
    },
    "dependentRequired": {_HIGH[0]: [_HIGH[1]], _HIGH[1]: [_HIGH[0]]},
}
_BODY: Final = {
    "requestBody": {
        "required": True,
        "description": "curl -F left_out1_low=@left.png -F right_out1_low=@right.png -F f=0.8449 -F t=0.16 URL",
        "content": {
            "multipart/form-data": {
                "schema": _FORM,
                "encoding": {name: {"contentType": "image/png, image/jpeg, image/webp"} for name in (*_LOW, *_HIGH)},
            }
        },
    }
}


def upload_router(*services: StereoService) -> APIRouter:
    """Return the routes ``/api/v2/pipelines/N/test/set``: ``POST`` shows a pair, ``DELETE`` the scene."""
    api = APIRouter(tags=["Stereo camera"])
    for number, service in enumerate(services):
        _add(api, f"/api/v2/pipelines/{number}/test/set", service)
    return api


def _add(api: APIRouter, path: str, service: StereoService) -> None:

    @api.post(path, summary="Show a stereo pair", responses=json_example(_DONE) | _ERROR_RESPONSES, openapi_extra=_BODY)
    async def post(request: Request) -> Any:
        try:
            form = await _form(request, service.config.max_upload)
            try:
                service.show_pairs(await _pair(service, form))
            finally:
                await form.close()
        except RestError as error:
            return error.response()
        except QueueFull as error:
            return JSONResponse({"message": str(error)}, 503, {"Retry-After": str(error.retry_after)})
        except PoolClosed as error:
            return JSONResponse({"message": str(error)}, 503, {"Retry-After": "1"})
        except DeadlineExceeded as error:
            return JSONResponse({"message": f"decoding was stopped: {error}"}, 503)
        except (ValueError, ImageError, MultiPartException) as error:
            return RestError(400, str(error)).response()
        return _DONE

    @api.delete(path, summary="Show the scene again", responses=json_example(_DONE))
    async def delete() -> Any:
        service.show_pairs(None)
        return _DONE


async def _form(request: Request, limit: int) -> FormData:
    """Return the form.

    Raises:
        RestError: the body has more than ``limit`` bytes.
        ValueError: wrong content type.
        MultiPartException: malformed form.
    """
    sent = request.headers.get("content-type", "")
    if len(sent) > MAX_CONTENT_TYPE:
        raise ValueError(f"Content-Type has {len(sent)} characters, the limit is {MAX_CONTENT_TYPE}")
    kind, options = parse_options_header(sent)
    if kind != b"multipart/form-data" or not options.get(b"boundary"):
        raise ValueError(f"the content type is {sent[:80]!r}, multipart/form-data with a boundary is needed")
    # Drop everything but the boundary: a charset chosen by the client may take minutes to decode (idna).
    boundary = options[b"boundary"].replace(b"\\", b"\\\\").replace(b'"', b'\\"')
    headers = Headers(raw=[(b"content-type", b'multipart/form-data; boundary="' + boundary + b'"')])

    async def limited() -> AsyncIterator[bytes]:
        size = 0
        async for chunk in request.stream():
            size += len(chunk)
            if size > limit:
                raise RestError(413, f"the form is larger than {limit} bytes")
            yield chunk

    return await MultiPartParser(headers, limited(), max_files=4, max_fields=8).parse()  # type: ignore[arg-type]  # an async generator is wanted


async def _pair(service: StereoService, form: FormData) -> PairImaging:
    """Return the pair of a form.

    Raises:
        ValueError: missing or invalid field.
        ImageError: an image cannot be decoded.
    """
    low, high = [await _file(form, name) for name in _LOW], [await _file(form, name) for name in _HIGH]
    if low[0] is None or low[1] is None:
        raise ValueError("the form needs the files left_out1_low and right_out1_low")
    high_pair = None
    if high[0] is not None or high[1] is not None:
        if high[0] is None or high[1] is None:
            raise ValueError("left_out1_high and right_out1_high need each other")
        high_pair = (high[0], high[1])
    config = service.scene_imaging.config
    pairs = Pairs([Pair((low[0], low[1]), high_pair)], config.max_pair_pixels)
    focal = _number(form, "f", config.model.focal_factor)
    baseline = _number(form, "t", config.model.baseline)
    return await service.workers.run(pair_imaging, service.scene_imaging, pairs, focal, baseline)


async def _file(form: FormData, name: str) -> bytes | None:
    value = form.get(name)
    return await value.read() if isinstance(value, UploadFile) else None


def _number(form: FormData, name: str, default: float) -> float:
    value = form.get(name)
    if value is None or value == "":
        return default
    try:
        return float(value) if isinstance(value, str) and len(value) < 64 else float("nan")
    except ValueError:
        raise ValueError(f"{name}: {str(value)[:80]!r} is not a number") from None
