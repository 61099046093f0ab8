"""The route ``/view/scene.html``: the page, the scene and its recent motion in one file."""

from __future__ import annotations

from typing import Annotated, Final

from fastapi import APIRouter, Query, Request, Response

from gateway.adapters.viewer.recording import MAX_BYTES
from gateway.adapters.viewer.scene_file import SceneFileWriter
from gateway.runtime.http.openapi import example
from gateway.runtime.http.plain_error_route import PlainErrorRoute
from gateway.runtime.http.section_files import DEFAULT_RATE, Rate, Seconds, SectionFiles, section_responses
from gateway.scene.page.live_page import LivePage
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.timeline import Timeline

View = Annotated[
    str,
    Query(
        max_length=2000,
        description="Camera to open with, as after # in the page's address. Default: the home view.",
        openapi_examples=example("eye=2,-2,1.5;target=0,0,0.5"),
    ),
]
HEADERS: Final = {"Content-Disposition": 'attachment; filename="scene.html"'}
"""A file, not a page of the gateway: opened from here it would be one that any client of the scene could fill."""


def share_router(
    tree: LiveTree, page: LivePage, history: Timeline | None = None, max_bytes: int = MAX_BYTES
) -> APIRouter:
    """Return the routes of this module.

    Args:
        history: recent states of the tree; None: there is none.
        max_bytes: limit of a recording.
    """
    router = APIRouter(tags=["Browser view"], route_class=PlainErrorRoute)
    files = SectionFiles(tree, history)

    @router.get(
        "/view/scene.html",
        summary="The page with the scene in one file",
        response_class=Response,
        responses=section_responses("text/html"),
    )
    async def scene_file(
        request: Request, seconds: Seconds = None, rate: Rate = DEFAULT_RATE, view: View = ""
    ) -> Response:
        """The page with the scene and its recent motion, which a browser opens without a gateway."""
        writer = SceneFileWriter(page, view, max_bytes)
        return await files.response(request, writer, seconds, rate, "text/html; charset=utf-8", HEADERS)

    return router
