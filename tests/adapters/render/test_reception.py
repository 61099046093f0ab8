"""The render endpoint on a real port: bodies in pieces, disconnects, stalls, memory."""

import asyncio
import gc
import gzip
import json
import random
import re
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from gateway.adapters.render import service
from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.form import FormReader
from tests.adapters.render.conftest import Start, WatchedRenderer
from tests.runtime.http.listening import listening
from tests.support.forms import CONTENT_TYPE, body, drake_fields, gltf
from tests.support.waiting import SECONDS, until

LARGE = json.dumps(gltf(extras=[n * n for n in range(60_000)])).encode()
"""400 kB: more than a connection is read at a time."""


def request(form: bytes) -> bytes:
    head = f"POST /render HTTP/1.1\r\nHost: h\r\nContent-Type: {CONTENT_TYPE}\r\nContent-Length: {len(form)}\r\n\r\n"
    return head.encode() + form


def cut(data: bytes, seed: int) -> Iterator[bytes]:
    """Pieces of very different lengths."""
    lengths = random.Random(seed)
    at = 0
    while at < len(data):
        count = int(10 ** lengths.uniform(0, 5.5))
        yield data[at : at + count]
        at += count


async def answer(reader: asyncio.StreamReader) -> tuple[int, bytes]:
    head = await reader.readuntil(b"\r\n\r\n")
    length = next(int(line[15:]) for line in head.lower().split(b"\r\n") if line.startswith(b"content-length:"))
    return int(head.split()[1]), await reader.readexactly(length)


@pytest.mark.parametrize("seed", range(4))
async def test_image_does_not_depend_on_body_pieces(start: Start, watched: WatchedRenderer, seed: int) -> None:
    async with start(watched) as server, listening(server.app) as port, asyncio.timeout(SECONDS):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        for kind in ("color", "depth", "label"):
            form = body(LARGE, drake_fields(kind))
            whole = await server.post(form, CONTENT_TYPE)
            for piece in cut(request(form), seed):
                writer.write(piece)
                await writer.drain()
            assert await answer(reader) == (200, whole.content)
        writer.close()
        assert [call[0].instances for call in watched.calls]
        assert len(watched.calls) == 6
        assert server.service.inflight_bytes == 0


async def test_compressed_forms_are_refused_by_name(start: Start, watched: WatchedRenderer) -> None:
    form = gzip.compress(body(LARGE, drake_fields("color")))
    async with start(watched) as server, listening(server.app) as port, asyncio.timeout(SECONDS):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(request(form).replace(b"Host: h", b"Host: h\r\nContent-Encoding: gzip", 1))
        status, text = await answer(reader)
        assert status == 415
        assert b"gzip" in text
        writer.close()


async def test_disconnected_clients_free_their_places(start: Start, watched: WatchedRenderer) -> None:
    watched.go_on.clear()
    async with start(watched, threads=1) as server, listening(server.app) as port, asyncio.timeout(SECONDS):
        writers = []
        for waiting in range(2):
            _, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(request(body(LARGE)))
            await until(lambda waiting=waiting: server.workers.stats.waiting == waiting)  # type: ignore[misc]  # no type for a default
            await until(lambda: server.workers.stats.running == 1)
            writers.append(writer)
        for writer in reversed(writers):
            writer.close()
        await until(lambda: server.workers.stats.waiting == 0)
        await until(lambda: [record.status for record in server.records] == [499, 499])
        watched.go_on.set()
        await until(lambda: server.workers.stats.running == 0)
        assert server.service.inflight_bytes == 0
        assert server.arriving == 0


async def test_stalled_uploads_are_408_and_stored(start: Start, watched: WatchedRenderer, tmp_path: Path) -> None:
    config = RenderConfig(receive_timeout=0.05, keep_failures=tmp_path)
    form = body(LARGE)
    async with start(watched, config) as server, listening(server.app) as port, asyncio.timeout(SECONDS):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(request(form)[:-10])
        status, sentence = await answer(reader)
        writer.close()
        assert status == 408
        told: Any = re.match(rb"no data for 0\.05 s after (\d+) bytes", sentence)
        count = int(told[1])  # on a slow machine nothing may have come for so long before the end of what was sent
        assert 0 < count <= len(form) - 10
        assert server.service.inflight_bytes == 0
        kept = [path.read_bytes() for path in tmp_path.glob("*.multipart")]  # noqa: ASYNC240 - nothing else runs
        assert any(form[:count] in data for data in kept)


@pytest.mark.parametrize("scene", [LARGE, b"y" * 400_000])
async def test_bodies_are_released_without_the_garbage_collector(
    start: Start, watched: WatchedRenderer, monkeypatch: pytest.MonkeyPatch, scene: bytes
) -> None:
    """A client may send hundreds of megabytes, whether they are a scene or not."""
    readers: list[weakref.ref[FormReader]] = []

    class Watched(FormReader):
        def __init__(self, *given: object) -> None:
            super().__init__(*given)  # type: ignore[arg-type]  # whatever the endpoint gives
            readers.append(weakref.ref(self))

    monkeypatch.setattr(service, "FormReader", Watched)
    async with start(watched) as server, listening(server.app) as port, asyncio.timeout(SECONDS):
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        gc.disable()
        try:
            writer.write(request(body(scene, drake_fields("depth"))))
            assert (await answer(reader))[0] == (200 if scene is LARGE else 400)
            await until(lambda: readers[0]() is None)
        finally:
            gc.enable()
        writer.close()
