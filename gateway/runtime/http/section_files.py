"""Responses with the recent motion of the scene in one file: ``/view/scene.html`` and ``/scene/motion.glb``."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Annotated, Final

from fastapi import Query, Request, Response

from gateway.runtime.http.disconnect import while_connected
from gateway.runtime.http.openapi import Responses, error_responses, example, file_response
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.sampling import SectionWriter, write_section
from gateway.scene.tree.timeline import Timeline

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


def section_responses(media_type: str, description: str = "The file.") -> Responses:
    """Return the OpenAPI descriptions of the responses of ``SectionFiles``."""
    return {
        **file_response(description, media_type),
        **error_responses(
            {413: "The file would be larger than the limit.", 500: "A texture of the scene cannot be decoded."}
        ),
    }


class SectionFiles:
    """Writes files of the last seconds, one at a time."""

    def __init__(self, tree: LiveTree, timeline: Timeline | None) -> None:
        """
        Args:
            timeline: Recent states of the tree; None: there are none, and files have the newest state.
        """
        self._tree = tree
        self._timeline = timeline
        self._one_at_a_time = asyncio.Lock()

    async def response(
        self,
        request: Request,
        writer: SectionWriter,
        seconds: float | None,
        rate: float,
        media_type: str,
        headers: Mapping[str, str] | None = None,
    ) -> Response:
        """Return the response with a file, for a ``PlainErrorRoute``.

        Args:
            seconds: Length of the motion; None: all that is kept.
            rate: Samples per second.
        """
        body = await while_connected(request, self._write(writer, seconds, rate))
        return Response(body, media_type=media_type, headers={"Cache-Control": "no-store", **(headers or {})})

    async def _write(self, writer: SectionWriter, seconds: float | None, rate: float) -> bytes:
        async with self._one_at_a_time:
            if self._timeline is None:
                snapshot = self._tree.snapshot
                await asyncio.to_thread(writer.add, snapshot.timestamp, snapshot)
                return await asyncio.to_thread(writer.finish, snapshot.timestamp)
            timeline = self._timeline.held()
            start, end = timeline.span
            if seconds is not None:
                start = max(start, end - int(seconds * 1e9))
            return await write_section(writer, timeline, start, end, rate, asyncio.to_thread)
