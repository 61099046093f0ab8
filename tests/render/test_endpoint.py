"""The endpoint as HTTP clients meet it: answers, refusals, waiting, leaving."""

from __future__ import annotations

import asyncio
import json
import logging
from pathlib import Path

import cv2
import httpx2
import numpy as np
import pytest
from numpy.typing import NDArray
from structlog.testing import capture_logs

from gateway.render.config import RenderConfig
from gateway.scene.geometry import Box, Part
from gateway.scene.tree import Node, TreeEdit
from renderers.drawlist import ImageError, Instance, Material
from renderers.port import Output
from tests.render.conftest import LONG, Start, WatchedRenderer
from tests.support.forms import CONTENT_TYPE, body, drake_fields, gltf, part

SCENE = json.dumps(gltf()).encode()


def decoded(response: httpx2.Response) -> NDArray[np.generic]:
    image = cv2.imdecode(np.frombuffer(response.content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return image[..., ::-1] if image.ndim == 3 else image


def assert_refused(response: httpx2.Response, status: int, *words: str) -> None:
    assert response.status_code == status
    assert response.headers["content-type"] == "text/plain; charset=utf-8"
    assert 0 < len(response.content) < 8192
    assert int(response.headers["content-length"]) == len(response.content)
    text = response.content.decode()
    assert all(word in text for word in words), text


async def test_three_pictures(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched) as server:
        color, depth, label = [
            await server.post(body(SCENE, drake_fields(image_type)), CONTENT_TYPE)
            for image_type in ("color", "depth", "label")
        ]
    assert color.status_code == depth.status_code == label.status_code == 200
    assert color.headers["content-type"] == label.headers["content-type"] == "image/png"
    assert depth.headers["content-type"] == "image/tiff"
    for response in (color, depth, label):
        assert int(response.headers["content-length"]) == len(response.content)
        assert response.headers["x-request-id"]
        stages = [stage.split(";")[0] for stage in response.headers["server-timing"].split(", ")]
        assert stages == ["queue", "parse", "render", "encode"]
    assert decoded(color).shape == (48, 64, 3)
    assert (decoded(color) == (204, 229, 255)).all()
    assert decoded(depth).dtype == np.float32
    assert (decoded(depth) == 2.0).all()
    assert (decoded(label) == (255, 0, 0)).all()
    assert [call[2] for call in watched.calls] == [Output.COLOR, Output.DEPTH, Output.LABEL]
    assert watched.closed == 3
    assert [(record.status, record.error) for record in server.records] == [(200, "")] * 3
    assert server.records[0].picture is not None
    assert server.service.status()["answers"] == {"200": 3}
    assert server.service.status()["inflight_bytes"] == 0
    assert server.service.status()["scene_cache"] == {"hits": 2, "misses": 1}


async def test_the_camera_is_the_forms_and_the_nodes(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched) as server:
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
        assert (await server.post(body(SCENE, drake_fields(near="0.000000")), CONTENT_TYPE)).status_code == 200
        no_znear = json.dumps(gltf(cameras=[{"type": "perspective", "perspective": {"yfov": 1}}])).encode()
        assert (await server.post(body(no_znear, drake_fields(near="0")), CONTENT_TYPE)).status_code == 200
    camera = watched.calls[0][1]
    assert (camera.width, camera.height, camera.fx, camera.fy) == (64, 48, 57.941125, 57.941125)
    assert (camera.cx, camera.cy, camera.near, camera.far) == (31.5, 23.5, 0.01, 10.0)
    np.testing.assert_array_equal(camera.X_world_camera, np.diag((1.0, -1.0, -1.0, 1.0)))
    assert watched.calls[1][1].near == 0.01  # the scene's camera still knows
    assert 0.0 < watched.calls[2][1].near <= 1e-5


@pytest.mark.parametrize(
    ("generator", "look", "name"),
    [
        ("VTK", "auto", "phong"),
        ("Drake glTF merger", "auto", "pbr"),
        ("Blender", "auto", "pbr"),
        ("VTK", "pbr", "pbr"),
        ("Drake glTF merger", "phong", "phong"),
    ],
)
async def test_the_look_follows_the_generator(
    start: Start, watched: WatchedRenderer, generator: str, look: str, name: str
) -> None:
    async with start(watched, RenderConfig(look=look, background=(1, 2, 3))) as server:  # type: ignore[arg-type]
        response = await server.post(body(gltf(generator=generator)), CONTENT_TYPE)
    assert watched.calls[0][3].name == name
    assert (decoded(response) == (1, 2, 3)).all()


async def test_depth_is_limited_and_may_be_millimetres(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched) as server:
        near = await server.post(body(SCENE, drake_fields("depth", min_depth="2")), CONTENT_TYPE)
        far = await server.post(body(SCENE, drake_fields("depth", max_depth="2")), CONTENT_TYPE)
    assert (decoded(near) == 0.0).all()
    assert np.isposinf(decoded(far)).all()
    async with start(watched, RenderConfig(depth_format="png16")) as server:
        for changes, value in (({}, 2000), ({"min_depth": "2"}, 0), ({"max_depth": "2"}, 65535)):
            response = await server.post(body(SCENE, drake_fields("depth", **changes)), CONTENT_TYPE)
            assert response.headers["content-type"] == "image/png"
            assert decoded(response).dtype == np.uint16
            assert (decoded(response) == value).all()


async def test_a_backdrop_is_drawn_without_labels(start: Start, watched: WatchedRenderer) -> None:
    edit = TreeEdit(Node())
    edit.set_parts(("wall",), (Part(Box((1.0, 1.0, 1.0)), Material(base_color=(0.0, 1.0, 0.0, 1.0))),))
    root = edit.commit()
    async with start(watched, backdrop=lambda: root) as server:
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
    instances = watched.calls[0][0].instances
    assert [instance.label for instance in instances] == [255, 0xFFFFFF]
    assert watched.calls[1][0].instances[1] is instances[1]  # flattened once

    labelled = watched.calls[0][0]
    async with start(watched, backdrop=lambda: labelled) as server:
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
    assert [instance.label for instance in watched.calls[2][0].instances] == [255, 0xFFFFFF, 0xFFFFFF]
    assert isinstance(watched.calls[2][0].instances[0], Instance)


async def test_refusals_are_plain_text_with_a_reason(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched) as server:
        assert_refused(await server.post(b"{}", "application/json"), 400, "multipart/form-data", "application/json")
        assert_refused(await server.post(body(SCENE, drake_fields(width="0")), CONTENT_TYPE), 400, "width", "'0'")
        assert_refused(await server.post(body(SCENE, drake_fields("depth", min_depth=None)), CONTENT_TYPE), 400, "min_")
        assert_refused(await server.post(body(b"not a scene"), CONTENT_TYPE), 400, "scene: ", "JSON")
        broken = gltf(meshes=[{"primitives": [{"attributes": {"POSITION": 7}}]}])
        assert_refused(await server.post(body(broken), CONTENT_TYPE), 400, "scene: ", "meshes[0]", "7")
        escape = drake_fields(image_type="\x1b[31m\u202e" + "x" * 500)
        refused = await server.post(body(SCENE, escape), CONTENT_TYPE)
        assert_refused(refused, 400, "image_type", r"\x1b[31m", "characters")
        assert b"\x1b" not in refused.content
        watched.error = ImageError("image 'wood' (images[2]): not a PNG, JPEG or WebP file")
        assert_refused(await server.post(body(SCENE), CONTENT_TYPE), 400, "scene: image 'wood' (images[2])")
    assert [record.status for record in server.records] == [400] * 7
    assert server.records[1].error == "width must be a whole number from 1 to 16384, got '0'"


async def test_defects_are_short_and_logged_with_an_id(
    start: Start, watched: WatchedRenderer, caplog: pytest.LogCaptureFixture
) -> None:
    watched.error = RuntimeError("secret inner state")
    with caplog.at_level(logging.ERROR):
        async with start(watched) as server:
            response = await server.post(body(SCENE), CONTENT_TYPE)
            assert_refused(response, 500, response.headers["x-request-id"])
            watched.error = None
            assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
    assert "secret" not in response.text


async def test_what_is_ignored_is_a_logged_warning(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched) as server:
        with capture_logs() as lines:
            odd = body(gltf(extensionsUsed=["ACME_x"]), drake_fields(zorp="1"))
            assert (await server.post(odd, CONTENT_TYPE)).status_code == 200
    told = {line["warning"] for line in lines if line["log_level"] == "warning"}
    assert "extensionsUsed: ACME_x ignored" in told
    assert any("zorp" in text for text in told)


async def test_a_failing_observer_changes_nothing(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched) as server:
        server.service._on_done = lambda record: 1 // 0
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200


async def test_too_large_is_refused_early_or_on_the_way(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched, RenderConfig(max_body_bytes=10_000)) as server:
        sent = 0

        async def chunks() -> object:
            nonlocal sent
            for _ in range(1000):
                sent += 1000
                yield b"x" * 1000 if sent > 1000 else part("scene", b"x" * 900)[:1000]

        headers = {"Content-Type": CONTENT_TYPE}
        announced = await server.client.post(
            "/render", content=chunks(), headers={**headers, "Content-Length": "1000000"}
        )
        assert_refused(announced, 413, "1000000 bytes", "10000", "max_body_bytes")
        assert sent == 0
        counted = await server.client.post("/render", content=chunks(), headers=headers)
        assert_refused(counted, 413, "10000", "max_body_bytes")
        assert 10_000 < sent <= 12_000
        assert server.service.status()["inflight_bytes"] == 0


async def test_a_limit_of_the_framework_does_not_hide_the_reason(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched, RenderConfig(max_body_bytes=1000)) as server:
        server.app.max_body_size = 1000
        assert_refused(await server.post(body(b"x" * 5000), CONTENT_TYPE), 413, "max_body_bytes")


async def test_a_stalled_upload_is_given_up(start: Start, watched: WatchedRenderer) -> None:
    async def stalled() -> object:
        yield body(SCENE)[:200]
        await asyncio.Event().wait()

    async with start(watched, RenderConfig(receive_timeout=0.01)) as server:
        response = await server.client.post("/render", content=stalled(), headers={"Content-Type": CONTENT_TYPE})
        assert_refused(response, 408, "no data for 0.01 s after 200 bytes")
        assert server.service.status()["inflight_bytes"] == 0


async def test_waiting_is_normal_and_beyond_the_bound_comes_retry_after(start: Start, watched: WatchedRenderer) -> None:
    watched.go_on.clear()
    async with start(watched, threads=1, max_waiting=3) as server:
        posts = [asyncio.create_task(server.post(body(SCENE), CONTENT_TYPE)) for _ in range(4)]
        assert await asyncio.to_thread(watched.started.wait, LONG)
        async with asyncio.timeout(LONG):
            while server.workers.stats.waiting < 3:  # noqa: ASYNC110 - the queue has no event to wait for
                await asyncio.sleep(0)
        refused = await server.post(body(SCENE), CONTENT_TYPE)
        assert_refused(refused, 503, "busy", "3 requests are waiting")
        assert int(refused.headers["retry-after"]) >= 1
        watched.go_on.set()
        assert [response.status_code for response in await asyncio.gather(*posts)] == [200] * 4
        assert server.service.status()["inflight_bytes"] == 0


async def test_arriving_bodies_have_places_and_a_full_queue_refuses_before_the_body(
    start: Start, watched: WatchedRenderer
) -> None:
    watched.go_on.clear()
    read, come = 0, asyncio.Event()

    async def late() -> object:
        nonlocal read
        read += 1
        await come.wait()
        yield body(SCENE)

    async def post() -> httpx2.Response:
        return await server.client.post("/render", content=late(), headers={"Content-Type": CONTENT_TYPE})

    async with start(watched, threads=1, max_waiting=2) as server:
        posts = [asyncio.create_task(post()) for _ in range(3)]
        async with asyncio.timeout(LONG):
            while server.service.arriving < 3:  # noqa: ASYNC110 - a count has no event to wait for
                await asyncio.sleep(0)
        assert_refused(await post(), 503, "2 requests are waiting already (3 of them still arriving)")
        assert read == 3
        come.set()
        watched.go_on.set()
        assert [response.status_code for response in await asyncio.gather(*posts)] == [200] * 3
        assert server.service.arriving == 0


async def test_who_arrives_too_slowly_does_not_keep_others_out(start: Start, watched: WatchedRenderer) -> None:
    come = asyncio.Event()

    async def trickling() -> object:
        yield body(SCENE)[:100]
        await come.wait()
        yield body(SCENE)[100:]

    async with start(watched, RenderConfig(arrival_seconds=0.01), threads=1, max_waiting=0) as server:
        headers = {"Content-Type": CONTENT_TYPE}
        slow = asyncio.create_task(server.client.post("/render", content=trickling(), headers=headers))
        async with asyncio.timeout(LONG):
            while server.service.arriving < 1:  # noqa: ASYNC110 - a count has no event to wait for
                await asyncio.sleep(0)
            while server.service.arriving > 0:  # noqa: ASYNC110
                await asyncio.sleep(0.001)
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
        come.set()
        assert (await slow).status_code == 200


async def test_bodies_in_flight_are_bounded(start: Start, watched: WatchedRenderer) -> None:
    watched.go_on.clear()
    size = len(body(SCENE))
    async with start(watched, RenderConfig(max_inflight_bytes=size + 10), threads=2) as server:
        first = asyncio.create_task(server.post(body(SCENE), CONTENT_TYPE))
        assert await asyncio.to_thread(watched.started.wait, LONG)
        assert server.service.status()["inflight_bytes"] == size
        refused = await server.post(body(SCENE), CONTENT_TYPE)
        assert_refused(refused, 503, "max_inflight_bytes")
        assert int(refused.headers["retry-after"]) >= 1
        watched.go_on.set()
        assert (await first).status_code == 200
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200


async def test_a_client_that_leaves_frees_its_place(start: Start, watched: WatchedRenderer) -> None:
    watched.go_on.clear()
    async with start(watched, threads=1) as server:
        held = asyncio.create_task(server.post(body(SCENE), CONTENT_TYPE))
        assert await asyncio.to_thread(watched.started.wait, LONG)
        leave, sent = asyncio.Event(), []
        whole = [{"type": "http.request", "body": body(SCENE), "more_body": False}]

        async def receive() -> dict[str, object]:
            if whole:
                return whole.pop()
            await leave.wait()
            return {"type": "http.disconnect"}

        async def send(message: dict[str, object]) -> None:
            sent.append(message)

        scope = {
            "type": "http",
            "asgi": {"version": "3.0"},
            "http_version": "1.1",
            "method": "POST",
            "scheme": "http",
            "path": "/render",
            "raw_path": b"/render",
            "query_string": b"",
            "root_path": "",
            "headers": [(b"content-type", CONTENT_TYPE.encode())],
        }
        leaver = asyncio.create_task(server.app(scope, receive, send))  # type: ignore[arg-type]
        async with asyncio.timeout(LONG):
            while server.workers.stats.waiting < 1:  # noqa: ASYNC110
                await asyncio.sleep(0)
            leave.set()
            await leaver
        assert server.workers.stats.waiting == 0
        assert [record.status for record in server.records] == [499]
        watched.go_on.set()
        assert (await held).status_code == 200
        assert len(watched.calls) == 1


async def test_other_methods_tell_how_to_use_it(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched) as server:
        response = await server.client.get("/render")
        assert_refused(response, 405, "POST", "multipart/form-data", "curl", "http://test/render")
        assert response.headers["allow"] == "POST"
        assert (await server.client.head("/render")).status_code == 405


async def test_docs_describe_the_form(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched, RenderConfig(path="/elsewhere/render")) as server:
        schema = (await server.client.get("/openapi.json")).json()
        assert (await server.client.post("/elsewhere/render", content=b"")).status_code == 400
    operation = schema["paths"]["/elsewhere/render"]["post"]
    form = operation["requestBody"]["content"]["multipart/form-data"]["schema"]
    assert form["properties"]["scene"]["format"] == "binary"
    assert set(drake_fields("depth")) | {"scene", "scene_sha256"} == set(form["properties"])
    assert set(operation["responses"]) == {"200", "400", "408", "413", "500", "503"}
    defaults = {name: str(p["default"]) for name, p in form["properties"].items() if "default" in p}
    async with start(watched) as server:  # what /docs proposes is a request that works
        assert (await server.post(body(SCENE, defaults), CONTENT_TYPE)).status_code == 200


async def test_rejected_requests_are_kept_for_replay(start: Start, watched: WatchedRenderer, tmp_path: Path) -> None:
    folder = tmp_path / "failures"
    config = RenderConfig(keep_failures=folder, keep_failures_count=2, keep_failures_bytes=100_000)
    bad = body(SCENE, drake_fields(width="0"))
    async with start(watched, config) as server:
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
        assert not folder.exists()
        assert (await server.post(bad, CONTENT_TYPE)).status_code == 400
        (kept,) = folder.glob("*.multipart")
        assert kept.read_bytes() == bad
        facts = json.loads(kept.with_suffix(".json").read_text())
        assert facts["content_type"] == CONTENT_TYPE
        assert facts["status"] == 400
        assert "width" in facts["reason"]
        replay = await server.post(kept.read_bytes(), facts["content_type"])
        assert replay.text == facts["reason"]

        mine = folder / "notes.multipart"
        mine.write_text("of the operator")
        for _ in range(3):
            assert (await server.post(bad, CONTENT_TYPE)).status_code == 400
        assert len(list(folder.glob("2*.multipart"))) == 2
        assert len(list(folder.glob("2*.json"))) == 2
        assert mine.exists()
        assert not kept.exists()
        assert (await server.post(body(b"x" * 200_000), CONTENT_TYPE)).status_code == 400  # larger than the folder
        assert len(list(folder.glob("2*.multipart"))) == 2
        hostile = {"Content-Type": "text/plain", "X-Request-ID": "../../../evil"}
        assert (await server.client.post("/render", content=b"x", headers=hostile)).status_code == 400
    assert [path.name for path in tmp_path.iterdir()] == ["failures"]  # noqa: ASYNC240


async def test_a_folder_that_cannot_be_written_does_not_hide_the_reason(
    start: Start, watched: WatchedRenderer, tmp_path: Path
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    async with start(watched, RenderConfig(keep_failures=blocked / "failures")) as server:
        assert_refused(await server.post(body(SCENE, drake_fields(width="0")), CONTENT_TYPE), 400, "width")
