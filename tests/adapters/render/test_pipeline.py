"""The scene cache, depth conversion and antialiasing."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.errors import RequestError
from gateway.adapters.render.form import FormReader
from gateway.adapters.render.pipeline import Pipeline
from gateway.adapters.render.scenes import SceneStore
from gateway.files.gltf import GltfCache, GltfError, GltfLimits, HashedDocument
from gateway.scene.draw.style import Style
from renderers.cache import CacheBudget
from renderers.raster import CpuRenderer
from tests.support.forms import CONTENT_TYPE, body, drake_fields, gltf


def scene(**changes: Any) -> HashedDocument:
    return GltfCache().look_up(json.dumps(gltf(**changes)).encode(), GltfLimits())


def test_scene_cache_is_least_recently_used() -> None:
    store = SceneStore(RenderConfig(scene_cache_count=2))
    scenes = [scene(color=(shade, 0.0, 0.0, 1.0)) for shade in (0.1, 0.2, 0.3)]
    first, second = store.get(scenes[0]), store.get(scenes[1])
    assert store.get(scenes[0]) is first
    store.get(scenes[2])  # the second goes
    assert store.get(scenes[0]) is first
    assert store.get(scenes[1]) is not second
    assert (store.scenes.hits, store.scenes.misses) == (2, 4)
    assert (
        first.draw_list.instances[0].mesh is second.draw_list.instances[0].mesh
    )  # geometry is shared, whatever the colours


def test_scene_cache_is_limited_in_bytes() -> None:
    one = scene()
    store = SceneStore(RenderConfig(), CacheBudget(len(one.data)))  # its geometry comes on top
    assert store.get(one) is not store.get(one)
    assert (store.scenes.hits, store.scenes.misses) == (0, 2)


def test_unreadable_scenes_are_not_cached() -> None:
    store = SceneStore(RenderConfig())
    for _ in range(2):
        with pytest.raises(GltfError):
            store.get(store.look_up(b"{"))
    assert (store.scenes.hits, store.scenes.misses) == (0, 2)


def test_wrong_scene_hash_is_refused() -> None:
    """The upload went wrong; the sentence names both hashes."""
    renderer, wrong = CpuRenderer(1), hashlib.sha256(b"other").hexdigest()
    data = json.dumps(gltf()).encode()
    reader = FormReader(CONTENT_TYPE, RenderConfig())
    reader.feed(body(data, drake_fields(scene_sha256=wrong)))
    with pytest.raises(RequestError, match="scene_sha256 does not match") as caught:
        Pipeline(renderer, RenderConfig()).render(reader.request())
    renderer.close()
    assert wrong in str(caught.value)
    assert hashlib.sha256(data).hexdigest() in str(caught.value)


def test_fxaa_can_be_turned_off() -> None:
    """Labels and depth never are: only two values, the edge as hard as the geometry."""
    renderer = CpuRenderer(1)
    shades = {}
    for antialias in ("fxaa", "none"):
        config = RenderConfig(style=Style(antialias=antialias, samples=1))
        pipeline = Pipeline(renderer, config)
        for kind in ("color", "label"):
            reader = FormReader(CONTENT_TYPE, config)
            reader.feed(body(gltf(), drake_fields(kind)))
            image = pipeline.render(reader.request())
            shades[antialias, kind] = len(np.unique(_pixels(image.body), axis=0))
    renderer.close()
    assert shades["none", "color"] == shades["none", "label"] == shades["fxaa", "label"] == 2
    assert shades["fxaa", "color"] > 5


def test_meshes_without_a_label_are_a_warning_of_label_images() -> None:
    renderer, config = CpuRenderer(1), RenderConfig()
    pipeline = Pipeline(renderer, config)
    bare = gltf(meshes=[{"primitives": [{"attributes": {"POSITION": 0}}]}])
    warnings = {}
    for name, document, kind in (("bare", bare, "label"), ("bare", bare, "color"), ("labelled", gltf(), "label")):
        reader = FormReader(CONTENT_TYPE, config)
        reader.feed(body(document, drake_fields(kind)))
        warnings[name, kind] = pipeline.render(reader.request()).warnings
    renderer.close()
    assert ["(1 here)" in text for text in warnings["bare", "label"]] == [True]
    assert warnings["bare", "color"] == warnings["labelled", "label"] == ()


def _pixels(png: bytes) -> NDArray[np.generic]:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    return image.reshape(-1, 3)


def test_strict_refuses_a_scene_with_a_warning() -> None:
    renderer = CpuRenderer(1)
    document = gltf(extensionsUsed=["X_unknown"], materials=[{"extensions": {"X_unknown": {}}}])
    warnings: list[str] = []
    for strict in (False, True):
        config = RenderConfig(strict=strict)
        reader = FormReader(CONTENT_TYPE, config)
        reader.feed(body(document, drake_fields("depth")))
        request = reader.request()
        if strict:
            with pytest.raises(RequestError) as caught:
                Pipeline(renderer, config).render(request)
            assert str(caught.value) == f"scene: {warnings[0]} (refused: --strict)"
        else:
            warnings.extend(Pipeline(renderer, config).render(request).warnings)
            assert "X_unknown" in warnings[0]
    renderer.close()
