"""The web server of ``scenegate dataset show``: pages and images of one dataset, for browsers on this machine."""

from __future__ import annotations

import asyncio
import hashlib
import io
from collections.abc import Callable
from dataclasses import replace
from importlib.resources import files
from typing import Annotated, Final, Literal

from fastapi import Depends, FastAPI, Path, Query, Request, Response
from fastapi.responses import HTMLResponse, PlainTextResponse

from gateway.datasets.show.overlay import LAYERS, draw_sample, shown_types
from gateway.datasets.show.page import PAGE_SAMPLES, Selection, grid_page, sample_page
from gateway.datasets.show.summary import summarize
from gateway.runtime.http.http_server import MainServer, server_config
from gateway.runtime.http.middleware import Protection
from gateway.runtime.workers import process_tuning
from scenegate.datasets import Dataset, RecordError, manifest
from scenegate.datasets.manifest import ImageType

HOST: Final = "127.0.0.1"
"""Loopback: the page has no access control."""
SHUTDOWN_SECONDS: Final = 1.0
"""Time for images that are being drawn at the end."""
MAX_WIDTH: Final = 2000
"""Maximum width of a drawn image in pixels."""
MAX_DRAWN: Final = 4
"""Maximum number of images that are drawn at a time; further requests wait."""
JPEG_QUALITY: Final = 88
CONTENT_SECURITY_POLICY: Final = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; form-action 'self'; base-uri 'none'"
)
STATIC: Final = {"show.css": "text/css", "show.js": "text/javascript"}
"""Content types of the files of the page."""

SampleNumber = Annotated[int, Path(ge=0)]


async def _selection(
    layer: Annotated[list[Literal["masks", "boxes", "poses", "none"]] | None, Query(max_length=8)] = None,
    image: ImageType | None = None,
    class_id: Annotated[int | None, Query(alias="class")] = None,
    page: Annotated[int, Query(ge=0)] = 0,
) -> Selection:
    """Return what an address selects. Without a layer these are all; a form always sends ``none``, too."""
    layers = LAYERS if layer is None else tuple(name for name in LAYERS if name in layer)
    return Selection(layers, image, class_id, page)


def create_app(dataset: Dataset) -> FastAPI:
    """Return the application. It reads no file but those of the page and the images that the manifest names.

    Raises:
        RecordError: a line of the manifest cannot be read.
    """
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None)
    app.add_middleware(Protection)
    summary = summarize(dataset)
    classes = dict(dataset.classes)
    drawing = asyncio.Semaphore(MAX_DRAWN)

    async def html(make: Callable[[], str]) -> Response:
        page = await asyncio.to_thread(make)
        return HTMLResponse(
            page, headers={"Content-Security-Policy": CONTENT_SECURITY_POLICY, "Cache-Control": "no-cache"}
        )

    @app.exception_handler(RecordError)
    async def unreadable(request: Request, error: Exception) -> Response:
        return PlainTextResponse(str(error), 500)

    @app.exception_handler(IndexError)
    async def missing(request: Request, error: Exception) -> Response:
        return PlainTextResponse(f"the dataset has {len(dataset)} samples", 404)

    @app.get("/")
    async def grid(selection: Annotated[Selection, Depends(_selection)]) -> Response:
        page = min(selection.page, len(dataset) // PAGE_SAMPLES)
        return await html(lambda: grid_page(dataset, summary, replace(selection, page=page)))

    @app.get("/sample/{number}")
    async def sample(number: SampleNumber, selection: Annotated[Selection, Depends(_selection)]) -> Response:
        return await html(lambda: sample_page(dataset, number, selection))

    @app.get("/image/{number}")
    async def drawn(
        request: Request,
        number: SampleNumber,
        width: Annotated[int, Query(ge=16, le=MAX_WIDTH)],
        selection: Annotated[Selection, Depends(_selection)],
    ) -> Response:
        sample = dataset[number]
        if selection.image not in (None, *shown_types(sample)):
            return PlainTextResponse(f"{sample.id} has no {selection.image} image that can be drawn", 404)
        version = hashlib.sha256(manifest.encode(sample.record)).hexdigest()[:16]
        headers = {"ETag": f'"{version}"', "Cache-Control": "no-cache"}
        if request.headers.get("if-none-match") == headers["ETag"]:
            return Response(status_code=304, headers=headers)
        async with drawing:
            picture = await asyncio.to_thread(draw_sample, sample, classes, selection.layers, width, selection.image)
        data = io.BytesIO()
        picture.save(data, "JPEG", quality=JPEG_QUALITY)
        return Response(data.getvalue(), media_type="image/jpeg", headers=headers)

    @app.get("/static/{name}")
    async def static(name: str) -> Response:
        if name not in STATIC:
            return PlainTextResponse("the page has no such file", 404)
        text = (files("gateway.datasets.show") / "static" / name).read_text("utf-8")
        return Response(text, media_type=STATIC[name], headers={"Cache-Control": "no-cache"})

    return app


def serve_dataset(dataset: Dataset, port: int, started: Callable[[str], object]) -> None:
    """Serve the page until SIGINT or SIGTERM.

    Args:
        port: TCP port; 0: any.
        started: called with the URL of the page.

    Raises:
        OSError: the port cannot be used; the message is one sentence.
        RecordError: a line of the manifest cannot be read.
    """
    app = create_app(dataset)
    try:
        listener = process_tuning.listen(HOST, port)
    except OSError as error:
        raise OSError(f"--port {port}: {process_tuning.listen_error(error, HOST, port)}") from None
    started(f"http://{HOST}:{listener.getsockname()[1]}/")
    server = MainServer(server_config(app, SHUTDOWN_SECONDS, lifespan=False))
    asyncio.run(server.serve(sockets=[listener]))
