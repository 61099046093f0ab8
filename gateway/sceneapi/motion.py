"""The scene with its motion as glTF with an animation: ``GET /scene/motion.glb``, and for logs."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import PlainTextResponse
from starlette.requests import ClientDisconnect

from gateway.gltf.export import MAX_BYTES, ExportError, Motion, export_motion_glb
from gateway.scene.sampling import SamplingError, samples
from gateway.scene.timeline import Timeline
from gateway.server.disconnect import CLIENT_GONE, while_connected
from gateway.server.openapi import example
from renderers.drawlist import ImageError

DEFAULT_RATE: Final = 30.0
"""Default number of samples per second: the motion looks continuous."""
MAX_RATE: Final = 240.0
Seconds = Annotated[
    float | None,
    Query(
        ge=0,
        le=1e9,
        description="Motion of the last seconds. Default: all that is kept.",
        openapi_examples=example(10.0),
    ),
]
Rate = Annotated[
    float,
    Query(gt=0, le=MAX_RATE, description="Samples of the scene per second", openapi_examples=example(DEFAULT_RATE)),
]
_TEXT: Final = {"text/plain": {"schema": {"type": "string"}}}
_RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    200: {
        "description": "The file. Its asset.extras.warnings has sentences about what it does not have.",
        "content": {"model/gltf-binary": {"schema": {"type": "string", "format": "binary"}}},
    },
    413: {"description": "The file would be larger than the limit.", "content": _TEXT},
    500: {"description": "A texture of the scene cannot be decoded.", "content": _TEXT},
}


async def motion_glb(
    timeline: Timeline,
    start: int,
    end: int,
    rate: float,
    max_bytes: int = MAX_BYTES,
    on_progress: Callable[[float], None] = lambda done: None,
) -> bytes:
    """Return a section of a timeline as ``.glb``. Threads do the work.

    Args:
        start: first time, nanoseconds since the epoch.
        end: last time.
        rate: samples per second.
        on_progress: called now and then with the fraction that is done.

    Raises:
        ExportError: the file would be too large.
        SamplingError: there are too many samples.
        ImageError: a texture cannot be decoded.
    """
    motion = Motion(max_bytes)
    first: int | None = None
    async for sample in samples(timeline, start, end, rate):
        first = sample.time if first is None else first
        await asyncio.to_thread(motion.add, (sample.time - first) / 1e9, sample.snapshot.root)
        on_progress(sample.done)
    return await asyncio.to_thread(export_motion_glb, motion, max_bytes=max_bytes)


def motion_router(timeline: Timeline, max_bytes: int = MAX_BYTES) -> APIRouter:
    """Return the route of the recent motion."""
    routes = APIRouter(tags=["The live scene"])
    one_at_a_time = asyncio.Lock()

    async def make(seconds: float | None, rate: float) -> bytes:
        async with one_at_a_time:
            start, end = timeline.span
            if seconds is not None:
                start = max(start, end - int(seconds * 1e9))
            return await motion_glb(timeline, start, end, rate, max_bytes)

    @routes.get("/scene/motion.glb", summary="Download the motion", response_class=Response, responses=_RESPONSES)
    async def motion(request: Request, seconds: Seconds = None, rate: Rate = DEFAULT_RATE) -> Response:
        """The scene with its recent motion, as binary glTF with an animation: Y up, textures embedded."""
        try:
            body = await while_connected(request, make(seconds, rate))
        except ClientDisconnect:
            return Response(status_code=CLIENT_GONE)
        except (ExportError, SamplingError) as error:
            return PlainTextResponse(str(error), 413)
        except ImageError as error:
            return PlainTextResponse(f"a texture of the scene cannot be decoded: {error}", 500)
        return Response(body, media_type="model/gltf-binary", headers={"Cache-Control": "no-store"})

    return routes
