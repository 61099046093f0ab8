"""The route ``/view/scene.html``: the page, the scene and its recent motion in one file."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any, Final

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import PlainTextResponse
from starlette.requests import ClientDisconnect

from gateway.scene.live import LiveTree, Snapshot
from gateway.scene.live_page import LivePage
from gateway.scene.sampling import SamplingError
from gateway.scene.timeline import Timeline
from gateway.server.disconnect import CLIENT_GONE, while_connected
from gateway.server.openapi import example
from gateway.viewer.encoder import encode_page
from gateway.viewer.recording import RecordingLimits, RecordingTooLargeError, record
from gateway.viewer.scene_file import scene_html

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
_TEXT: Final = {"text/plain": {"schema": {"type": "string"}}}
_RESPONSES: Final[dict[int | str, dict[str, Any]]] = {
    200: {"description": "The file.", "content": {"text/html": {"schema": {"type": "string"}}}},
    413: {"description": "The file would be larger than the limit.", "content": _TEXT},
}


class Still:
    """A timeline with one state."""

    def __init__(self, snapshot: Snapshot) -> None:
        self._snapshot = snapshot

    @property
    def span(self) -> tuple[int, int]:
        """The time from which the state was valid, twice."""
        return self._snapshot.timestamp, self._snapshot.timestamp

    async def snapshot_at(self, time: int) -> Snapshot:
        """Return the state."""
        return self._snapshot


def page_settings(page: LivePage) -> bytes:
    """Return the frame with a page's view settings. Nobody receives clicks on a recording, so nothing is clickable."""
    recorded = LivePage()
    recorded.view = page.view
    return encode_page(recorded)


def share_router(
    tree: LiveTree, page: LivePage, history: Timeline | None = None, limits: RecordingLimits | None = None
) -> APIRouter:
    """Return the routes of this module.

    Args:
        history: recent states of the tree; None: there is none.
    """
    routes = APIRouter(tags=["Browser view"])
    one_at_a_time = asyncio.Lock()

    async def make(seconds: float | None, rate: float, view: str) -> bytes:
        async with one_at_a_time:
            timeline = Still(tree.snapshot) if history is None or seconds == 0 else history
            start, end = timeline.span
            if seconds is not None:
                start = max(start, end - int(seconds * 1e9))
            recording = await record(timeline, page_settings(page), start, end, rate, limits)
            return await asyncio.to_thread(scene_html, recording, view)

    @routes.get(
        "/view/scene.html", summary="The page with the scene in one file", response_class=Response, responses=_RESPONSES
    )
    async def scene_file(
        request: Request, seconds: Seconds = None, rate: Rate = DEFAULT_RATE, view: View = ""
    ) -> Response:
        """The page with the scene and its recent motion, which a browser opens without a gateway."""
        try:
            body = await while_connected(request, make(seconds, rate, view))
        except ClientDisconnect:
            return Response(status_code=CLIENT_GONE)
        except (RecordingTooLargeError, SamplingError) as error:
            return PlainTextResponse(str(error), 413)
        # A file, not a page of the gateway: opened from here it would be one that any client of the scene could fill.
        headers = {"Cache-Control": "no-store", "Content-Disposition": 'attachment; filename="scene.html"'}
        return Response(body, media_type="text/html; charset=utf-8", headers=headers)

    return routes
