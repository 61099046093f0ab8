"""The scene cache, depth conversion and antialiasing."""

import hashlib
import json
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.errors import RequestError
from gateway.adapters.render.form import FormReader
from gateway.adapters.render.pipeline import EncodedImage, Pipeline
from gateway.adapters.render.scenes import SceneStore
from gateway.files.assets.light_rig_file import read_rig
from gateway.files.gltf import GltfCache, GltfError, GltfLimits, HashedDocument
from gateway.scene.draw.style import Style
from renderers.cache import CacheBudget
from renderers.interface import LookName
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


def rendered(
    renderer: CpuRenderer, document: Any, kind: str = "color", config: RenderConfig | None = None, **fields: str
) -> EncodedImage:
    config = config or RenderConfig()
    reader = FormReader(CONTENT_TYPE, config)
    reader.feed(body(document, drake_fields(kind, **fields)))
    return Pipeline(renderer, config).render(reader.request())


def test_wrong_scene_hash_is_refused(renderer: CpuRenderer) -> None:
    """The upload went wrong; the sentence names both hashes."""
    wrong, data = hashlib.sha256(b"other").hexdigest(), json.dumps(gltf()).encode()
    with pytest.raises(RequestError, match="scene_sha256 does not match") as caught:
        rendered(renderer, data, scene_sha256=wrong)
    assert wrong in str(caught.value)
    assert hashlib.sha256(data).hexdigest() in str(caught.value)


@pytest.mark.parametrize("look", get_args(LookName))
def test_an_environment_map_lights_only_the_look_studio(renderer: CpuRenderer, look: LookName, tmp_path: Path) -> None:
    path = tmp_path / "room.hdr"
    path.write_bytes(cv2.imencode(".hdr", np.full((8, 16, 3), 0.5, np.float32))[1].tobytes())
    styles = Style(), Style(rig=read_rig(path))
    dark, lit = (
        rendered(renderer, gltf(), config=RenderConfig(style=style), scenegate_look=look).body for style in styles
    )
    assert (lit != dark) is (look == "studio")


def test_fxaa_can_be_turned_off(renderer: CpuRenderer) -> None:
    """Labels and depth never are: only two values, the edge as hard as the geometry."""
    shades = {}
    for antialias in ("fxaa", "none"):
        config = RenderConfig(style=Style(antialias=antialias, samples=1))
        for kind in ("color", "label"):
            image: Any = cv2.imdecode(
                np.frombuffer(rendered(renderer, gltf(), kind, config).body, np.uint8), cv2.IMREAD_COLOR
            )
            shades[antialias, kind] = len(np.unique(image.reshape(-1, 3), axis=0))
    assert shades["none", "color"] == shades["none", "label"] == shades["fxaa", "label"] == 2
    assert shades["fxaa", "color"] > 5


def test_meshes_without_a_label_are_a_warning_of_label_images(renderer: CpuRenderer) -> None:
    bare = gltf(meshes=[{"primitives": [{"attributes": {"POSITION": 0}}]}])
    assert ["(1 here)" in text for text in rendered(renderer, bare, "label").warnings] == [True]
    assert rendered(renderer, bare).warnings == rendered(renderer, gltf(), "label").warnings == ()


def test_strict_refuses_a_scene_with_a_warning(renderer: CpuRenderer) -> None:
    document = gltf(extensionsUsed=["X_unknown"], materials=[{"extensions": {"X_unknown": {}}}])
    warning, *_ = rendered(renderer, document, "depth").warnings
    assert "X_unknown" in warning
    with pytest.raises(RequestError) as caught:
        rendered(renderer, document, "depth", RenderConfig(strict=True))
    assert str(caught.value) == f"scene: {warning} (refused: --strict)"
