"""Every model of KhronosGroup/glTF-Sample-Assets in the checkout that SCENEGATE_FIDELITY names (``bench/fidelity.py``):
it is drawn, or refused for one of the listed reasons."""

import os
import re
from pathlib import Path

import numpy as np
import pytest

from gateway.files.assets.scene_file import SceneFileError, read_scene_file
from gateway.scene.draw.cameras import parse_camera
from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.viewpoints import resolve_camera
from gateway.scene.tree.nodes import Node
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer

FOLDER = os.environ.get("SCENEGATE_FIDELITY", "")
REASONS = (
    r"extensionsRequired: KHR_\w+ cannot be read",
    # The checkout lacks a file that the model names.
    r"cannot be read: No such file or directory",
)


@pytest.mark.skipif(not FOLDER, reason="SCENEGATE_FIDELITY names no checkout of KhronosGroup/glTF-Render-Fidelity")
def test_every_model_is_drawn_or_a_gltf_error() -> None:
    root = Path(FOLDER) / "glTF-Render-Fidelity-Generator" / "glTF-Sample-Assets" / "Models"
    renderer = CpuRenderer()
    drawn: list[Path] = []
    refused: list[str] = []
    for path in sorted(path for path in root.rglob("*") if path.suffix in (".gltf", ".glb")):
        try:
            file = read_scene_file(path)
        except SceneFileError as error:
            refused.append(str(error))
            continue
        scene = flatten(file.root)
        camera = resolve_camera(parse_camera("fit"), Node(), 64, 48, draw_list=scene)
        frame = renderer.render(scene, camera, Output.COLOR | Output.DEPTH, Look("studio"))
        assert frame.color is not None
        assert frame.depth is not None
        assert np.isfinite(frame.depth).mean() > 0.02, path
        drawn.append(path)
    renderer.close()
    for message in refused:
        assert "\n" not in message
        assert any(re.search(reason, message) for reason in REASONS), message
    assert len(drawn) > 2 * len(refused), refused
    assert len(drawn) > 100
