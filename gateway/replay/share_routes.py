"""The route ``/view/scene.html``: the page, the scene and its recent motion in one file."""

import asyncio
from typing import Annotated, Final

from fastapi import APIRouter, Query, Request, Response

from gateway.replay.page_file import scene_html
from gateway.replay.page_recorder import MAX_BYTES, PageRecorder, record_section
from gateway.runtime.http.disconnect import while_connected
from gateway.runtime.http.openapi import error_responses, example, file_response
from gateway.runtime.http.plain_error_route import PlainErrorRoute
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.timeline import Timeline
from renderers.light_rig import STUDIO, Rig

DEFAULT_RATE: Final = 30.0
"""Default number of samples per second: the motion looks continuous."""
MAX_RATE: Final = 240.0
Seconds = Annotated[
    float | None,
    Query(
        ge=0,
        le=1e9,
        description="Motion of the last seconds; 0: the scene as it is. Default: all that the gateway has kept.",
        openapi_examples=example(10.0),
    ),
]
Rate = Annotated[
    float,
    Query(gt=0, le=MAX_RATE, description="Samples of the scene per second", openapi_examples=example(DEFAULT_RATE)),
]
View = Annotated[
    str,
    Query(
        max_length=2000,
        description="Camera to open with, as after # in the page's address. Default: the home view.",
        openapi_examples=example("eye=2,-2,1.5;target=0,0,0.5"),
    ),
]
HEADERS: Final = {"Cache-Control": "no-store", "Content-Disposition": 'attachment; filename="scene.html"'}
"""A file, not a page of the gateway: opened from here it would be one that any client of the scene could fill."""


def share_router(
    tree: LiveTree, page: LivePage, history: Timeline | None = None, max_bytes: int = MAX_BYTES, rig: Rig = STUDIO
) -> APIRouter:
    """Return the routes of this module. One file is written at a time.

    ``history``: recent states of the tree; None: files have the newest state. ``max_bytes``: limit of a recording.
    ``rig``: light of the page.
    """
    router = APIRouter(tags=["Browser view"], route_class=PlainErrorRoute)
    one_at_a_time = asyncio.Lock()

    async def written(seconds: float | None, rate: float, view: str) -> bytes:
        recorder = PageRecorder(page, max_bytes, rig)
        async with one_at_a_time:
            if history is None:
                snapshot = tree.snapshot
                await asyncio.to_thread(recorder.add, snapshot.timestamp, snapshot)
                recording = await asyncio.to_thread(recorder.finish, snapshot.timestamp)
            else:
                timeline = history.held()
                start, end = timeline.span
                if seconds is not None:
                    start = max(start, end - int(seconds * 1e9))
                recording = await record_section(recorder, timeline, start, end, rate, asyncio.to_thread)
            return await asyncio.to_thread(scene_html, recording, view)

    @router.get(
        "/view/scene.html",
        summary="The page with the scene in one file",
        response_class=Response,
        responses={
            **file_response("The file.", "text/html"),
            **error_responses(
                {413: "The file would be larger than the limit.", 500: "A texture of the scene cannot be decoded."}
            ),
        },
    )
    async def scene_file(
        request: Request, seconds: Seconds = None, rate: Rate = DEFAULT_RATE, view: View = ""
    ) -> Response:
        """The page with the scene and its recent motion, which a browser opens without a gateway."""
        body = await while_connected(request, written(seconds, rate, view))
        return Response(body, media_type="text/html; charset=utf-8", headers=HEADERS)

    return router
