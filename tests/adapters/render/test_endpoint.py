"""The render endpoint over HTTP: images, errors, and its description."""

import json
import logging
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
import structlog
from structlog.testing import capture_logs

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.form import LOOK_FIELD
from gateway.runtime.workers.pool_errors import DeadlineExceeded, PoolClosed, QueueFull
from gateway.scene.draw.style import LookChoice, Style
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, TreeEdit
from renderers.compiler.pending import KernelsDelayed
from renderers.drawlist import ImageError, Material
from renderers.interface import Output
from renderers.light_rig import Rig
from scenegate.messages.geometry import Box
from tests.adapters.render.conftest import SCENE, Start, WatchedRenderer, assert_refused, decoded
from tests.support.forms import CONTENT_TYPE, body, drake_fields, gltf


async def test_three_image_types(start: Start, watched: WatchedRenderer, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.DEBUG, "gateway.render")  # whose entries have the stages
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
        stages = [stage.split(";")[0] for stage in response.headers["server-timing"].split(", ")]
        assert stages == ["receive", "form", "queue", "parse", "render", "encode"]
    assert all(0 <= record.queue_seconds <= record.seconds for record in server.records)
    assert decoded(color).shape == (48, 64, 3)
    assert (decoded(color) == (204, 229, 255)).all()
    assert decoded(depth).dtype == np.float32
    assert (decoded(depth) == 2.0).all()
    assert (decoded(label) == (255, 0, 0)).all()
    assert [call[2] for call in watched.calls] == [Output.COLOR, Output.DEPTH, Output.LABEL]
    assert [(record.status, record.error) for record in server.records] == [(200, "")] * 3
    assert server.records[0].body == color.content
    assert server.outcomes() == {"ok": 3}
    assert server.service.status()["answers"] == {"200": 3}
    assert server.service.status()["inflight_bytes"] == 0
    assert server.service.status()["scene_cache"] == {"hits": 2, "misses": 1}


async def test_the_camera_is_the_forms_and_the_nodes(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched) as server:
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
        no_znear = json.dumps(gltf(cameras=[{"type": "perspective", "perspective": {"yfov": 1}}])).encode()
        assert (await server.post(body(no_znear, drake_fields(near="0")), CONTENT_TYPE)).status_code == 200
    camera = watched.calls[0][1]
    assert (camera.width, camera.height, camera.fx, camera.fy) == (64, 48, 57.941125, 57.941125)
    assert (camera.cx, camera.cy, camera.near, camera.far) == (31.5, 23.5, 0.01, 10.0)
    np.testing.assert_array_equal(camera.X_world_camera, np.diag((1.0, -1.0, -1.0, 1.0)))
    assert 0.0 < watched.calls[1][1].near <= 1e-5


@pytest.mark.parametrize(
    ("generator", "look", "field", "name"),
    [
        ("VTK", "auto", None, "phong"),
        ("Drake glTF merger", "auto", None, "pbr"),
        ("Blender", "auto", None, "gltf"),
        ("VTK", "pbr", None, "pbr"),
        ("VTK", "gltf", None, "gltf"),
        ("VTK", "studio", None, "studio"),
        ("Drake glTF merger", "phong", None, "phong"),
        ("Drake glTF merger", "phong", "plain", "plain"),
        ("Drake glTF merger", "studio", "auto", "pbr"),
    ],
)
async def test_the_look_follows_the_form_the_setting_and_the_generator(
    start: Start, watched: WatchedRenderer, generator: str, look: LookChoice, field: str | None, name: str
) -> None:
    rig = Rig(exposure=0.5)
    async with start(watched, RenderConfig(style=Style(look, (1, 2, 3), rig=rig))) as server:
        scene = json.dumps(gltf(generator=generator)).encode()
        response = await server.post(body(scene, drake_fields(scenegate_look=field)), CONTENT_TYPE)
    assert watched.calls[0][3].name == name
    assert watched.calls[0][3].rig == rig
    assert (decoded(response) == (1, 2, 3)).all()


async def test_depth_is_limited_and_may_be_millimetres(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched) as server:
        near = await server.post(body(SCENE, drake_fields("depth", min_depth="2")), CONTENT_TYPE)
        far = await server.post(body(SCENE, drake_fields("depth", max_depth="2")), CONTENT_TYPE)
    assert (decoded(near) == 0.0).all()
    assert (decoded(far) == np.inf).all()
    async with start(watched, RenderConfig(depth_format="png")) as server:
        for changes, value in (({}, 2000), ({"min_depth": "2"}, 0), ({"max_depth": "2"}, 65535)):
            response = await server.post(body(SCENE, drake_fields("depth", **changes)), CONTENT_TYPE)
            assert response.headers["content-type"] == "image/png"
            assert decoded(response).dtype == np.uint16
            assert (decoded(response) == value).all()


async def test_backdrop_has_no_labels(start: Start, watched: WatchedRenderer) -> None:
    edit = TreeEdit(Node())
    edit.set_parts(("wall",), (Part(Box((1.0, 1.0, 1.0)), Material(base_color=(0.0, 1.0, 0.0, 1.0))),))
    root = edit.commit()
    async with start(watched, backdrop=lambda: root) as server:
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
    instances = watched.calls[0][0].instances
    assert [instance.label for instance in instances] == [255, 0xFFFFFF]
    assert watched.calls[1][0].instances[1] is instances[1]  # flattened once


async def test_errors_are_plain_text_with_a_reason(start: Start, watched: WatchedRenderer) -> None:
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


async def test_internal_errors_are_short_and_logged_with_an_id(
    start: Start, watched: WatchedRenderer, caplog: pytest.LogCaptureFixture
) -> None:
    watched.error = RuntimeError("secret inner state")
    with caplog.at_level(logging.ERROR):
        async with start(watched) as server:
            with structlog.contextvars.bound_contextvars(request_id="drake-7"):
                response = await server.post(body(SCENE), CONTENT_TYPE)
            assert_refused(response, 500, "drake-7")
            watched.error = None
            assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
    assert "secret" not in response.text


async def test_ignored_content_is_logged_as_a_warning(start: Start, watched: WatchedRenderer) -> None:
    async with start(watched) as server:
        with capture_logs() as lines:
            odd = body(gltf(extensionsUsed=["ACME_x"]), drake_fields(zorp="1"))
            assert (await server.post(odd, CONTENT_TYPE)).status_code == 200
    told = {line["warning"] for line in lines if line["log_level"] == "warning"}
    assert "extensionsUsed: ACME_x ignored" in told
    assert any("zorp" in text for text in told)


@pytest.mark.parametrize(("images", "kept"), [(2, [False, True, True]), (0, [False] * 3)])
async def test_the_newest_requests_are_kept_with_their_images(
    start: Start, watched: WatchedRenderer, images: int, kept: list[bool]
) -> None:
    async with start(watched) as server:
        size = len((await server.post(body(SCENE), CONTENT_TYPE)).content)
    async with start(watched, RenderConfig(recent_count=3, recent_bytes=max(0, images * size))) as server:
        for _ in range(5):
            await server.post(body(SCENE), CONTENT_TYPE)
        assert [record.number for record in server.records] == [3, 4, 5]
        assert [bool(record.body) for record in server.records] == kept
        await server.post(b"x", CONTENT_TYPE)
        assert [bool(record.body) for record in server.records] == [*kept[1:], False]
    async with start(watched, RenderConfig(recent_count=0)) as server:
        assert (await server.post(body(SCENE), CONTENT_TYPE)).status_code == 200
        assert server.records == []


async def test_other_methods_respond_with_usage(start: Start, watched: WatchedRenderer) -> None:
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
    assert set(drake_fields("depth")) | {"scene", "scene_sha256", LOOK_FIELD} == set(form["properties"])
    *_, range_of_depth = form["allOf"]
    without_range, with_range = range_of_depth["anyOf"]
    assert without_range["properties"]["image_type"]["enum"] == ["color", "label"]
    assert with_range["required"] == ["min_depth", "max_depth"]
    assert set(operation["responses"]) == {"200", "400", "408", "413", "415", "500", "503"}
    defaults = {name: str(p["default"]) for name, p in form["properties"].items() if "default" in p}
    async with start(watched) as server:  # what /docs proposes is a request that works
        assert (await server.post(body(SCENE, defaults), CONTENT_TYPE)).status_code == 200


async def test_rejected_requests_are_stored_for_replay(start: Start, watched: WatchedRenderer, tmp_path: Path) -> None:
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

        for _ in range(3):
            assert (await server.post(bad, CONTENT_TYPE)).status_code == 400
        assert len(list(folder.iterdir())) == 4
        assert not kept.exists()
        hostile = {"Content-Type": "text/plain", "X-Request-ID": "../../../evil"}
        assert (await server.client.post("/render", content=b"x", headers=hostile)).status_code == 400
    assert [path.name for path in tmp_path.iterdir()] == ["failures"]  # noqa: ASYNC240 - nothing else runs


async def test_unwritable_failure_folder_does_not_hide_the_error(
    start: Start, watched: WatchedRenderer, tmp_path: Path
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    async with start(watched, RenderConfig(keep_failures=blocked / "failures")) as server:
        assert_refused(await server.post(body(SCENE, drake_fields(width="0")), CONTENT_TYPE), 400, "width")


@pytest.mark.parametrize(
    ("error", "retry_after", "text"),
    [
        (PoolClosed("the server is shutting down"), "1", "the server is shutting down"),
        (KernelsDelayed(8), "8", "could not be loaded, which is tried again; the server's log has the reason"),
        (DeadlineExceeded("it took longer than 3 s"), None, "rendering was stopped: it took longer than 3 s"),
        (QueueFull("8 calls wait", 4), "4", "the server is busy: 8 calls wait; try again in 4 s"),
    ],
)
async def test_requests_that_could_succeed_later(
    start: Start,
    watched: WatchedRenderer,
    error: Exception,
    retry_after: str | None,
    text: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with start(watched) as server:

        async def run(*_: object, **__: object) -> NoReturn:
            raise error

        monkeypatch.setattr(server.workers, "run", run)
        response = await server.post(body(SCENE), CONTENT_TYPE)
    assert (response.status_code, response.headers.get("retry-after")) == (503, retry_after)
    assert response.text.strip().endswith(text)
    assert server.outcomes() == {"slow" if isinstance(error, DeadlineExceeded) else "busy": 1}
    assert server.service.status()["inflight_bytes"] == 0


async def test_a_record_describes_request_image_and_scene(start: Start, watched: WatchedRenderer) -> None:
    large = json.dumps(gltf(extras="x" * 1_000_000)).encode()
    by_vtk = gltf(extensionsUsed=["ACME_x"])
    by_vtk["asset"]["generator"] = "g" * 90
    async with start(watched) as server:
        with_tint = body(by_vtk, drake_fields(tint="red"))
        for form in (body(large, drake_fields("depth")), with_tint, body(SCENE, drake_fields(width="0")), b"x"):
            await server.post(form, CONTENT_TYPE)
        warnings = server.service.status()["warnings"]
    depth, color, invalid, _ = server.records
    assert (depth.image_text, depth.kind, depth.media_type) == ("depth, 64 × 48", "depth", "image/tiff")
    assert depth.scene_text.startswith("scene of 1.0 MB")
    assert color.scene_text.startswith("scene of 0.")
    assert f" kB by {'g' * 76}, " in color.scene_text
    assert color.scene_text.endswith(" primitives")
    about_request = "the field 'tint' is unknown and ignored"
    assert color.warnings == tuple(warnings) == (about_request, "extensionsUsed: ACME_x ignored")
    assert (invalid.status, invalid.image_text, invalid.scene_text, invalid.kind) == (400, "not understood", "", "")
    assert (invalid.body, invalid.media_type, invalid.queue_seconds) == (b"", "", 0.0)
