"""The models of bghgary/glTF-Asset-Generator; its checkout is named by SCENEGATE_ASSET_GENERATOR."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from gateway.scene.flatten import flatten
from gateway.scene.scenefile import SceneFileError, read_scene_file

FOLDER = os.environ.get("SCENEGATE_ASSET_GENERATOR", "")
pytestmark = pytest.mark.skipif(not FOLDER, reason="SCENEGATE_ASSET_GENERATOR names no checkout of the models")


def models(kind: str) -> list[Path]:
    return sorted(path for path in (Path(FOLDER) / "Output" / kind).rglob("*") if path.suffix in (".gltf", ".glb"))


def test_positive_models_are_read() -> None:
    paths = models("Positive")
    assert len(paths) >= 163
    for path in paths:
        if "FAKE_materials_quantumRendering" in path.read_text("utf-8") and path.stem == "Compatibility_05":
            with pytest.raises(SceneFileError, match="extensionsRequired: FAKE_materials_quantumRendering cannot"):
                read_scene_file(path)  # the one that readers must refuse
            continue
        scene = read_scene_file(path)
        assert flatten(scene.root).instances, path


def test_negative_models_give_one_sentence() -> None:
    paths = models("Negative")
    assert len(paths) >= 16
    for path in paths:
        with pytest.raises(SceneFileError) as error:
            read_scene_file(path)
        assert "POSITION" in str(error.value) or "the largest of its component type" in str(error.value), path
        assert "\n" not in str(error.value)
