import asyncio
import io
import json
import math
import threading
from collections.abc import MutableMapping
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from fastapi import FastAPI
from numpy.typing import NDArray

from gateway.adapters.sceneapi.config import SceneApiConfig
from gateway.adapters.sceneapi.query import ImageQuery
from gateway.adapters.sceneapi.routes import router
from gateway.adapters.sceneapi.service import SceneApi
from gateway.files.gltf import read_gltf
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.draw.live_scene import LiveScene
from gateway.scene.draw.style import Style
from gateway.scene.tree.geometry import Part, PointCloud
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.transforms import look_at
from renderers.camera import Camera
from renderers.compiler import pending
from renderers.drawlist import ImageError, Material
from renderers.interface import Output
from scenegate.messages.geometry import Box
from tests.adapters.sceneapi.conftest import SPOT, World, client_of
from tests.support.endless import EndlessRenderer, waits_for_studio
from tests.support.waiting import until

SMALL = "width=64&height=48"


def decode(data: bytes, flags: int) -> NDArray[Any]:
    pixels: Any = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    return np.asarray(pixels)


async def test_the_listing_has_paths_kinds_bounds_labels_and_transforms(world: World) -> None:
    response = await world.client.get("/scene")
    assert response.headers["content-type"] == "application/json"
    assert response.headers["x-scene-revision"] == "1"
    listing = response.json()
    assert listing["revision"] == 1
    assert listing["node_count"] == 5
    nodes = {tuple(node["path"]): node for node in listing["nodes"]}
    assert list(nodes) == [(), ("robot",), ("robot", "base"), ("robot", "head"), ("frame",)]
    base, head = nodes["robot", "base"], nodes["robot", "head"]
    assert (base["kinds"], head["kinds"], nodes[()]["kinds"]) == (["box"], ["sphere"], [])
    assert base["bounds"] == [[-1, -1, -0.5], [1, 1, 0.5]]
    np.testing.assert_allclose(head["bounds"], [(-0.5, -0.5, 1.5), (0.5, 0.5, 2.5)], atol=1e-6)
    np.testing.assert_allclose(nodes["robot",]["bounds"], [(-1, -1, -0.5), (1, 1, 2.5)], atol=1e-6)
    assert nodes["robot",]["bounds"] == nodes[()]["bounds"] == listing["bounds"]
    frame = nodes["frame",]
    assert (frame["bounds"], frame["label"], frame["has_geometry"], base["has_geometry"]) == (None, None, False, True)
    assert base["label"] != head["label"]
    assert [row[3] for row in nodes["frame",]["transform"]] == [1, 2, 3, 1]


async def test_listing_has_the_labels_of_label_images(world: World) -> None:
    listing = (await world.client.get("/scene")).json()
    labels = {tuple(node["path"]): node["label"] for node in listing["nodes"]}
    response = await world.client.get(f"/scene/render?type=label&{SMALL}")
    drawn = world.renderer.calls[-1][0]
    assert [instance.label for instance in drawn.instances] == [labels["robot", "base"], labels["robot", "head"]]
    pixels = decode(response.content, cv2.IMREAD_UNCHANGED)[:, :, ::-1].astype(int)
    assert (pixels @ (1, 256, 65536))[1, 1] == labels["robot", "base"]
    assert (pixels @ (1, 256, 65536))[0, 0] == 0xFFFFFF


async def test_the_threshold_on_alpha_is_a_setting(world: World) -> None:
    world.service.config = SceneApiConfig(style=Style(alpha_threshold=0.25))
    await world.client.get(f"/scene/render?type=label&{SMALL}")
    assert world.renderer.calls[-1][3].alpha_threshold == 0.25


async def test_unchanged_scene_is_304(world: World) -> None:
    for path in ("/scene", "/scene.glb"):
        first = await world.client.get(path)
        again = await world.client.get(path, headers={"If-None-Match": f'"x", W/{first.headers["etag"]}'})
        assert (again.status_code, again.content) == (304, b"")
        assert again.headers["etag"] == first.headers["etag"]
    with world.tree.edit() as edit:
        edit.set_visible(("robot",), False)
        edit.set_opacity(("robot",), 0.5)
    changed = await world.client.get("/scene", headers={"If-None-Match": first.headers["etag"]})
    assert changed.status_code == 200
    assert changed.headers["x-scene-revision"] == "2"
    assert changed.headers["etag"] != first.headers["etag"]
    robot = changed.json()["nodes"][1]
    assert robot["opacity"] == 0.5
    assert (robot["visible"], robot["bounds"], changed.json()["bounds"]) == (False, None, None)


async def test_listing_with_non_finite_transforms_and_surrogates(world: World) -> None:
    with world.tree.edit() as edit:
        edit.set_pose(("lost",), (math.nan, math.inf, 0, 1, 0, 0, 0))
        edit.set_parts(("lost", "\ud800", 1 << 70), (Part(Box((1, 1, 1)), Material()),))
    listing = (await world.client.get("/scene")).json()
    nodes = {tuple(node["path"]): node for node in listing["nodes"]}
    assert nodes["lost",]["transform"][0][3] is None
    deepest = nodes["lost", "\\ud800", hex(1 << 70)]
    assert deepest["kinds"] == ["box"]
    assert deepest["bounds"] is None
    assert (await world.client.get("/scene.glb")).status_code == 200


async def test_listing_is_limited_and_counts_all_nodes(world: World) -> None:
    service = SceneApi(LiveScene(world.tree), world.renderer, world.workers, SceneApiConfig(max_nodes=5))
    assert service.listing().body.count(b'"path"') == 5
    service = SceneApi(LiveScene(world.tree), world.renderer, world.workers, SceneApiConfig(max_nodes=2))
    listing = json.loads(service.listing().body)
    root, robot = listing["nodes"]
    assert listing["node_count"] == 5
    assert root["bounds"] == robot["bounds"] == listing["bounds"], "nodes that are not listed count, too"


async def test_glb_contains_the_scene(world: World) -> None:
    response = await world.client.get("/scene.glb")
    assert response.headers["content-type"] == "model/gltf-binary"
    assert response.headers["x-scene-revision"] == "1"
    assert read_gltf(response.content).instance_count == 2


async def test_glb_contains_the_requested_camera(world: World) -> None:
    assert read_gltf((await world.client.get("/scene.glb")).content).camera is None
    response = await world.client.get("/scene.glb?camera=eye=3,0,0;target=0,0,0&width=64&height=48&far=9")
    assert (response.headers["cache-control"], "etag" in response.headers) == ("no-store", False)
    camera: Any = read_gltf(response.content).camera
    np.testing.assert_allclose(camera.X_world_camera[:3, 3], (3, 0, 0), atol=1e-12)
    assert read_gltf((await world.client.get("/scene.glb?width=64")).content).camera is not None
    for query, status, words in (
        ("camera=stereo", 404, "no stereo camera"),
        ("camera=path:[1]", 404, "no such node"),
        ("camera=fit&type=depth", 422, "type is no parameter of this URL"),
    ):
        refusal = await world.client.get(f"/scene.glb?{query}")
        assert (refusal.status_code, words in refusal.text) == (status, True), refusal.text


async def test_images_and_files_with_the_visibility_of_the_query(world: World) -> None:
    with world.tree.edit() as edit:
        edit.set_visible(("robot", "head"), False)
    query = """hide=[["robot","base"],["missing"]]&show=[["robot","head"]]"""
    read = read_gltf((await world.client.get(f"/scene.glb?{query}")).content)
    (path,) = (path for path, node in read.root.walk() if node.parts)
    assert "head" in path
    assert (await world.client.get(f"/scene/render?{query}")).status_code == 200
    (scene, *_) = world.renderer.calls[-1]
    assert len(scene.instances) == 1
    head: Any = world.tree.snapshot.root.find(("robot", "head"))
    assert not head.visible
    for text in ("robot", '["robot"]', "[[true]]", "[[1.5]]", "[" * 1000):
        refusal = await world.client.get("/scene/render", params={"hide": text})
        assert refusal.status_code == 422
        assert "is not a JSON list of paths" in refusal.text


async def test_background_of_the_query(world: World) -> None:
    assert (await world.client.get(f"/scene/render?{SMALL}&background=FF8000")).status_code == 200
    look: Any = world.renderer.calls[-1][3]
    assert look.background == (255, 128, 0)
    for text in ("#ff8000", "ff80", "ff800\n", "gg8000", "٠٠٠٠٠٠"):
        refusal = await world.client.get("/scene/render", params={"background": text})
        assert refusal.status_code == 422
        assert f"background={text!r} is not a colour in six hexadecimal digits" in refusal.text


async def test_glb_beyond_the_size_limit_is_413(world: World) -> None:
    world.service.config = SceneApiConfig(max_export_bytes=10)
    response = await world.client.get("/scene.glb")
    assert (response.status_code, "larger than 10 bytes" in response.text) == (413, True)


async def test_color_image(world: World) -> None:
    response = await world.client.get(f"/scene/render?{SMALL}&look=phong")
    assert response.headers["content-type"] == "image/png"
    assert response.headers["x-scene-revision"] == "1"
    assert response.headers["cache-control"] == "no-store"
    pixels = decode(response.content, cv2.IMREAD_UNCHANGED)
    assert pixels.shape == (48, 64, 3)
    _, camera, outputs, look = world.renderer.calls[-1]
    assert (camera.width, camera.height, outputs, look.name) == (64, 48, Output.COLOR, "phong")


@pytest.mark.parametrize(
    ("query", "look", "samples"),
    [("", "studio", 4), ("&samples=8", "studio", 8), ("&look=pbr", "pbr", 1), ("&look=plain&samples=4", "plain", 4)],
)
async def test_studio_with_four_samples_is_the_default(world: World, query: str, look: str, samples: int) -> None:
    await world.client.get(f"/scene/render?{SMALL}{query}")
    asked = world.renderer.calls[-1][3]
    assert (asked.name, asked.samples) == (look, samples)


@pytest.mark.parametrize(
    ("shape", "look", "kept"),
    [
        (PointCloud(np.zeros((1, 3), np.float32), {}), "plain", True),
        (PointCloud(np.zeros((1, 3), np.float32), {}), "phong", False),
        (Box((1, 1, 1)), "plain", False),
    ],
    ids=["points", "points as Drake shows them", "no points"],
)
async def test_fxaa_leaves_points_unchanged_in_the_plain_look(
    world: World, shape: Box | PointCloud, look: str, kept: bool
) -> None:
    with world.tree.edit() as edit:
        edit.delete(())
        edit.set_parts(("thing",), (Part(shape, Material()),))
    world.renderer.spot = (51, 102, 153)
    response = await world.client.get(f"/scene/render?{SMALL}&look={look}")
    pixels = decode(response.content, cv2.IMREAD_UNCHANGED)[:, :, ::-1]
    assert (tuple(pixels[SPOT]) == world.renderer.spot) is kept
    assert tuple(pixels[40, 40]) == (204, 229, 255)
    assert (Output.INSTANCE in world.renderer.calls[-1][2]) is kept


async def test_depth_image_in_metres_and_millimetres(world: World) -> None:
    response = await world.client.get(f"/scene/render?type=depth&{SMALL}")
    assert response.headers["content-type"] == "image/tiff"
    metres = tifffile.imread(io.BytesIO(response.content))
    assert (metres.dtype.name, metres[0, 0], metres[5, 5]) == ("float32", np.inf, 2.0)
    response = await world.client.get(f"/scene/render?type=depth&format=png&{SMALL}")
    assert response.headers["content-type"] == "image/png"
    millimetres = decode(response.content, cv2.IMREAD_UNCHANGED)
    assert (millimetres.dtype.name, millimetres[0, 0], millimetres[5, 5]) == ("uint16", 65535, 2000)


async def test_camera_comes_from_the_query(world: World) -> None:
    params: dict[str, Any] = {
        "camera": "eye=0,-5,1;target=0,0,1",
        "width": 40,
        "height": 20,
        "fovy": 90,
        "near": 0.5,
        "far": 9,
    }
    assert (await world.client.get("/scene/render", params=params)).status_code == 200
    camera = world.renderer.calls[-1][1]
    assert camera.fy == pytest.approx(10.0)
    assert (camera.near, camera.far) == (0.5, 9.0)
    np.testing.assert_allclose(camera.X_world_camera, look_at((0, -5, 1), (0, 0, 1), (0, 0, 1)))
    assert (await world.client.get("/scene/render", params={"camera": 'path:["frame"]'})).status_code == 200
    np.testing.assert_allclose(world.renderer.calls[-1][1].X_world_camera[:3, 3], (1, 2, 3))


async def test_stereo_camera_if_there_is_one(world: World) -> None:
    response = await world.client.get("/scene/render?camera=stereo")
    assert (response.status_code, response.text) == (404, "camera 'stereo': this gateway runs no stereo camera")
    sensor = Camera(1280, 960, 1000, 1000, 640, 480, 0.1, 10, np.eye(4))
    service = SceneApi(LiveScene(world.tree, stereo_camera=lambda snapshot: sensor), world.renderer, world.workers)
    service.image(ImageQuery(camera="stereo", width=64, height=48))
    assert world.renderer.calls[-1][1].fx == pytest.approx(50.0)


@pytest.mark.parametrize(
    ("query", "sentence"),
    [
        ("width=0", "width: Input should be greater than or equal to 1, got '0'"),
        ("height=1e3", "height: Input should be a valid integer"),
        ("height=99999999999999999999", "320x99999999999999999999 is too large"),
        ("width=1001&height=1", "1001x1 is too large; the limits are 1000 pixels per side"),
        ("width=1000&height=101", "1000x101 is too large; the limits are 1000 pixels per side and 100000"),
        (f"{SMALL}&type=normals", "type: Input should be 'color', 'depth' or 'label', got 'normals'"),
        (f"{SMALL}&look=cartoon", "look: Input should be 'phong', 'pbr', 'gltf', 'plain' or 'studio', got 'cartoon'"),
        (f"{SMALL}&samples=2", "samples: Input should be 1, 4 or 8, got '2'"),
        (f"{SMALL}&format=bmp", "format: Input should be 'tiff' or 'png', got 'bmp'"),
        (f"{SMALL}&fovy=5e-324", "fovy: Input should be greater than or equal to 0.001, got '5e-324'"),
        (f"{SMALL}&fovy=wide", "fovy: Input should be a valid number"),
        (f"{SMALL}&near=nan", "near: Input should be less than or equal to 1000000000000, got 'nan'"),
        (f"{SMALL}&near=-1", "near: Input should be greater than or equal to 0.000000001, got '-1'"),
        (f"{SMALL}&far=1e13", "far: Input should be less than or equal to 1000000000000, got '1e13'"),
        (f"{SMALL}&camera=eye%3D1e-200,0,0;target%3D0,0,0", "eye and target coincide"),
        (f"{SMALL}&near=2&far=1", "near=2 must be less than far=1"),
        (f"{SMALL}&near=2&far=2", "near=2 must be less than far=2"),
        (f"{SMALL}&fovy=180", "fovy: Input should be less than 180"),
        (f"{SMALL}&camera=left", "camera 'left' is not one of"),
        (f"{SMALL}&camera=eye%3D1,2;target%3D0,0,0", "'eye=1,2' needs three numbers"),
        (f"{SMALL}&zoom=2", "zoom is no parameter of this URL"),
    ],
)
async def test_rejects_invalid_parameters(world: World, query: str, sentence: str) -> None:
    response = await world.client.get(f"/scene/render?{query}")
    assert response.status_code == (400 if "1e-200" in query else 422)
    assert response.headers["content-type"].startswith("text/plain")
    assert sentence in response.text
    assert world.renderer.calls == []


@pytest.mark.parametrize("query", ["width=1000&height=100", "width=100&height=1000", f"{SMALL}&near=1e-09&far=1e%2B12"])
async def test_parameters_at_their_limits_are_valid(world: World, query: str) -> None:
    response = await world.client.get(f"/scene/render?{query}")
    assert response.status_code == 200, response.text
    camera = world.renderer.calls[-1][1]
    assert query.startswith(f"width={camera.width}&height={camera.height}")


@pytest.mark.parametrize(
    ("query", "size"), [("width=40", (40, 240)), ("height=30", (320, 30)), ("", (320, 240))], ids=["w", "h", "none"]
)
async def test_width_and_height_have_their_own_defaults(world: World, query: str, size: tuple[int, int]) -> None:
    await world.client.get(f"/scene/render?{query}")
    camera = world.renderer.calls[-1][1]
    assert (camera.width, camera.height) == size


@pytest.mark.parametrize("path", ['["nobody"]', "[%22%ED%A0%80%22]"])
async def test_camera_at_a_missing_node_is_404(world: World, path: str) -> None:
    response = await world.client.get(f"/scene/render?{SMALL}&camera=path:{path}")
    assert (response.status_code, "there is no such node" in response.text) == (404, True), response.text
    assert world.renderer.calls == []


@pytest.mark.parametrize(("query", "near", "far"), [("near=5000", 5000, 10_000), ("far=1e-6", 5e-7, 1e-6)])
async def test_single_clipping_plane_adjusts_the_other(world: World, query: str, near: float, far: float) -> None:
    assert (await world.client.get(f"/scene/render?{SMALL}&{query}")).status_code == 200
    camera = world.renderer.calls[-1][1]
    assert (camera.near, camera.far) == pytest.approx((near, far))


async def test_an_image_waits_for_its_kernels_without_a_worker_thread(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(world.renderer, "render", waits_for_studio(world.renderer.render))
    with pending.announced({"studio": lambda name: name.startswith("studio.")}):
        studio = asyncio.ensure_future(world.client.get(f"/scene/render?{SMALL}"))
        for query in ("look=plain", "type=depth"):
            assert (await world.client.get(f"/scene/render?{SMALL}&{query}")).status_code == 200
        assert [look.name for *_, look in world.renderer.calls][:1] == ["plain"]
        assert len(world.renderer.calls) == 2
        assert not studio.done()
        pending.finish("studio")
        assert (await studio).status_code == 200


async def test_undecodable_texture_is_500(world: World) -> None:
    world.renderer.error = ImageError("wood.png: broken data")
    response = await world.client.get(f"/scene/render?{SMALL}")
    assert response.status_code == 500
    assert "wood.png: broken data" in response.text


async def test_full_queue_is_503_with_retry_after(world: World) -> None:
    go_on = threading.Event()
    try:
        held = [asyncio.create_task(world.workers.run(go_on.wait, 30.0)) for _ in range(3)]
        await asyncio.sleep(0)
        response = await world.client.get(f"/scene/render?{SMALL}")
        assert response.status_code == 503
        assert int(response.headers["retry-after"]) >= 1
        assert (await world.client.get("/scene")).status_code == 503
    finally:
        go_on.set()
    await asyncio.gather(*held)


async def documented(world: World) -> list[dict[str, Any]]:
    document = (await world.client.get("/openapi.json")).json()
    return list(document["paths"]["/scene/render"]["get"]["parameters"])


async def test_documented_defaults_and_examples_are_valid(world: World) -> None:
    assert {each["name"] for each in await documented(world)} == ImageQuery.model_fields.keys()
    for parameter in await documented(world):
        name, schema, value = parameter["name"], parameter["schema"], parameter["examples"]["example"]["value"]
        assert not parameter["required"]
        for text in (value, schema.get("default", value), *schema.get("enum", ())):
            query = ImageQuery.model_validate({name: str(text)})
            assert getattr(query, name) == text
            if name in ("hide", "show"):
                paths = query.hidden if name == "hide" else query.shown
                assert [list(path) for path in paths] == json.loads(text)


@pytest.mark.parametrize("name", ["width", "height", "fovy", "near", "far"])
async def test_documented_limits_are_those_of_the_parser(world: World, name: str) -> None:
    schema = next(each["schema"] for each in await documented(world) if each["name"] == name)
    limits = {key: value for part in (schema, *schema.get("anyOf", ())) for key, value in part.items()}
    lowest, highest = limits["minimum"], limits.get("maximum", 179.999)
    for value in (lowest, highest):
        assert getattr(ImageQuery.model_validate({name: str(value)}), name) == value
    too_high = limits.get("exclusiveMaximum", highest * 2)
    for value in (lowest - 1 if name in ("width", "height") else lowest / 2, too_high):
        query = {**dict.fromkeys(("width", "height"), 1), name: value}
        assert (await world.client.get("/scene/render", params=query)).status_code == 422


async def test_documented_responses_are_those_of_each_route(world: World) -> None:
    paths = (await world.client.get("/openapi.json")).json()["paths"]
    statuses = {path: set(paths[path]["get"]["responses"]) for path in ("/scene", "/scene.glb", "/scene/render")}
    assert statuses == {
        "/scene": {"200", "304", "404", "422", "500", "503"},
        "/scene.glb": {"200", "304", "400", "404", "413", "422", "500", "503"},
        "/scene/render": {"200", "400", "404", "422", "500", "503"},
    }


async def test_status_counts_images(world: World) -> None:
    await world.client.get(f"/scene/render?{SMALL}")
    assert world.service.status() == {"revision": 1, "geometries": 2, "pictures": 1}


async def test_slow_rendering_is_stopped() -> None:
    renderer, workers = EndlessRenderer(), WorkerPool(1, seconds=0.05, limit_name="--render-seconds")
    async with client_of(SceneApi(LiveScene(LiveTree()), renderer, workers)) as client:
        response = await client.get(f"/scene/render?{SMALL}")
    assert response.status_code == 503
    assert "--render-seconds = 0.05 s" in response.text
    assert "retry-after" not in response.headers
    assert renderer.ended == 1
    assert await workers.close()


async def test_rendering_stops_when_the_client_disconnects() -> None:
    renderer, workers = EndlessRenderer(), WorkerPool(1)
    app = FastAPI()
    app.include_router(router(SceneApi(LiveScene(LiveTree()), renderer, workers)))
    async with asyncio.TaskGroup() as group:
        left, sent = asyncio.Event(), []

        async def receive() -> MutableMapping[str, Any]:
            await left.wait()
            return {"type": "http.disconnect"}

        async def send(message: MutableMapping[str, Any]) -> None:
            sent.append(message)

        query = SMALL.encode()
        scope = {"type": "http", "method": "GET", "path": "/scene/render", "query_string": query, "headers": []}
        group.create_task(app(scope, receive, send))
        await until(lambda: renderer.begun == 1)
        left.set()
    assert sent[0]["status"] == 499
    await until(lambda: renderer.ended == 1)
    assert await workers.close()
