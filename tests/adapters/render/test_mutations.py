"""Mutated requests: the response is an image or an error, never a 500, a hang, or unlimited memory."""

import asyncio
import json
from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from gateway.adapters.render.config import RenderConfig
from gateway.files.gltf import GltfLimits
from renderers.raster import CpuRenderer
from tests.adapters.render.conftest import Running, running
from tests.support.corpus import drake_scene
from tests.support.forms import CONTENT_TYPE, body, drake_fields, gltf
from tests.support.waiting import SECONDS

CONFIG = RenderConfig(
    max_body_bytes=4 << 20,
    gltf=GltfLimits(max_elements=200_000, max_vertices=200_000, max_drawn_elements=400_000, max_mesh_bytes=64 << 20),
)
"""Small bounds, so that reaching one takes milliseconds."""
FUZZ = settings(
    deadline=None,
    max_examples=100,
    suppress_health_check=list(HealthCheck),
    phases=(Phase.explicit, Phase.reuse, Phase.generate),
)
"""Without shrinking: a failing scene is small as it is, and shrinking one through an application takes minutes."""
SMALL = ("004_tiny_64x48", "016_label_codes", "017_vertex_color")

junk = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from((-1, 0, 1, 2, 3, 7, 5121, 5123, 5125, 5126, 2**31, 2**32, 2**53, 2**63, 10**30)),
    st.sampled_from((0.5, -0.0, 1e-300, 1e300, 1e-40, -1e39, float("nan"), float("inf"))),
    st.sampled_from(
        ("", "VEC3", "SCALAR", "MAT4", "MASK", "BLEND", "data:,", "data:;base64,AAAA", "file:///etc/passwd")
    ),
    st.sampled_from(([], {}, [0], [0.0] * 16, [1e200] * 16, [[]], {"node": 0})),
)


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in items:
        yield (*path, key)
        yield from places(inner, (*path, key))


def mutate(document: Any, data: st.DataObject) -> Any:
    for _ in range(data.draw(st.integers(1, 4))):
        paths = list(places(document))
        if not paths:
            break
        path = data.draw(st.sampled_from(paths))
        parent = document
        for key in path[:-1]:
            parent = parent[key]
        action = data.draw(st.sampled_from(("replace", "replace", "replace", "delete", "repeat", "move")))
        if action == "delete":
            del parent[path[-1]]
        elif action == "repeat" and isinstance(parent, list):
            parent.extend(deepcopy(parent[path[-1]]) for _ in range(data.draw(st.integers(1, 50))))
        elif action == "move":
            source = document
            for key in data.draw(st.sampled_from(paths)):
                source = source[key]
            parent[path[-1]] = deepcopy(source)
        else:
            parent[path[-1]] = deepcopy(data.draw(junk))
    return document


@pytest.fixture(scope="module")
def loop() -> Iterator[asyncio.AbstractEventLoop]:
    """One loop for all examples of a test: starting an application for each would take longer than the test."""
    loop = asyncio.new_event_loop()
    yield loop
    loop.close()


@pytest.fixture(scope="module")
def server(loop: asyncio.AbstractEventLoop, renderer: CpuRenderer) -> Iterator[Running]:
    context = running(renderer, CONFIG)
    yield loop.run_until_complete(context.__aenter__())
    loop.run_until_complete(context.__aexit__(None, None, None))


def assert_answered(loop: asyncio.AbstractEventLoop, server: Running, data: bytes, content_type: str) -> int:
    async def post() -> int:
        async with asyncio.timeout(SECONDS):
            response = await server.post(data, content_type)
        assert response.status_code in (200, 400, 413), (response.status_code, response.text)
        if response.status_code == 200:
            assert response.content[:4] in (b"\x89PNG", b"II*\0")
        else:
            assert 0 < len(response.content) < 8192
            assert response.content.decode().strip()
        return response.status_code

    return loop.run_until_complete(post())


def kinds(data: st.DataObject) -> str:
    return data.draw(st.sampled_from(("color", "depth", "label")))


@FUZZ
@given(st.data())
def test_mutated_scenes(loop: asyncio.AbstractEventLoop, server: Running, data: st.DataObject) -> None:
    scene = mutate(gltf(), data)
    assert_answered(loop, server, body(scene, drake_fields(kinds(data))), CONTENT_TYPE)


@FUZZ
@given(st.data())
def test_mutated_bytes_of_scenes(loop: asyncio.AbstractEventLoop, server: Running, data: st.DataObject) -> None:
    text = bytearray(json.dumps(gltf()).encode())
    for _ in range(data.draw(st.integers(1, 5))):
        start = data.draw(st.integers(0, len(text)))
        new = data.draw(
            st.text('0123456789-.eE,:[]{}"nulltrfas /+=\\', max_size=8).map(str.encode) | st.binary(max_size=8)
        )
        text[start : start + data.draw(st.integers(0, 8))] = new
    assert_answered(loop, server, body(bytes(text), drake_fields(kinds(data))), CONTENT_TYPE)


@FUZZ
@given(st.data())
def test_extreme_cameras(loop: asyncio.AbstractEventLoop, server: Running, data: st.DataObject) -> None:
    focal = st.sampled_from(("1e-9", "1e-3", "0.5", "1", "33", "1e3", "1e6", "1e9"))
    changes: dict[str, str | None] = {
        "width": data.draw(st.sampled_from(("1", "2", "33", "64"))),
        "height": data.draw(st.sampled_from(("1", "48"))),
        "near": data.draw(st.sampled_from(("0", "1e-12", "1e-9", "1e-6", "0.01", "1", "9.99999"))),
        "far": data.draw(st.sampled_from(("1e-5", "10", "1e3", "1e6", "1e12"))),
        "focal_x": data.draw(focal),
        "focal_y": data.draw(focal),
        "center_x": data.draw(st.sampled_from(("1e-9", "0.5", "0.999999"))),
        "center_y": data.draw(st.sampled_from(("1e-9", "0.5", "0.999999"))),
    }
    values = st.lists(st.sampled_from((0.0, 1.0, -1.0, 1e-30, 1e-3, 1e5, 1e14, 1e30)), min_size=12, max_size=12)
    matrix = list(data.draw(values))
    for corner in (3, 7, 11, 15):
        matrix.insert(corner, 1.0 if corner == 15 else 0.0)
    nodes = [{"children": [1, 2]}, {"mesh": 0, "matrix": matrix}, {"camera": 0}]
    if data.draw(st.booleans()):
        nodes[1], nodes[2] = {"mesh": 0}, {"camera": 0, "matrix": matrix}
    scene = gltf(nodes=nodes)
    assert_answered(loop, server, body(scene, drake_fields(kinds(data), **changes)), CONTENT_TYPE)


@pytest.mark.corpus
@FUZZ
@given(st.data())
def test_mutated_recorded_scenes(loop: asyncio.AbstractEventLoop, server: Running, data: st.DataObject) -> None:
    kind = kinds(data)
    recorded = drake_scene(data.draw(st.sampled_from(SMALL))).request(kind)
    scene = mutate(json.loads(recorded.scene), data)
    fields = {name: value for name, value in recorded.fields.items() if name != "scene_sha256"}
    assert_answered(loop, server, body(scene, fields), CONTENT_TYPE)


@pytest.mark.corpus
@FUZZ
@given(st.data())
def test_mutated_recorded_bodies(loop: asyncio.AbstractEventLoop, server: Running, data: st.DataObject) -> None:
    recorded = drake_scene(data.draw(st.sampled_from(SMALL))).request(kinds(data))
    text = bytearray(recorded.body)
    for _ in range(data.draw(st.integers(1, 5))):
        start = data.draw(st.integers(0, min(len(text), 3000)) | st.integers(0, len(text)))
        text[start : start + data.draw(st.integers(0, 30))] = data.draw(st.binary(max_size=30))
    assert_answered(loop, server, bytes(text), recorded.content_type)
