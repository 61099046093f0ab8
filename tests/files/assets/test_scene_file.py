"""Scene files that the operator names: up axis, files beside them, what is refused."""

import base64
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.files.assets.scene_file import SceneFile, SceneFileError, read_scene_file
from gateway.files.gltf import Up
from gateway.scene.draw.flatten import flatten
from tests.support import forms
from tests.support.bounds import scene_bounds


def written(folder: Path, **changes: Any) -> Path:
    path = folder / "scene.gltf"
    path.write_text(json.dumps(forms.gltf(**changes)))
    return path


def bounds(scene: SceneFile) -> np.ndarray:
    box = scene_bounds(flatten(scene.root))
    assert box is not None
    return box


ROTATED = ((-0.5, 1.0, -0.5), (0.5, 1.0, 0.5))
"""The triangle of ``forms.gltf``, x and y from -0.5 to 0.5 at z = -1, turned by +90 degrees about x."""
UNCHANGED = ((-0.5, -0.5, -1.0), (0.5, 0.5, -1.0))


@pytest.mark.parametrize(
    ("generator", "up", "expected"),
    [
        ("other", "auto", ROTATED),
        ("other", "z", UNCHANGED),
        ("VTK", "auto", ROTATED),
        ("VTK", "z", UNCHANGED),
        ("Drake glTF merger", "auto", UNCHANGED),
        ("VTK", "y", ROTATED),
    ],
)
def test_scenes_are_rotated_to_z_up(tmp_path: Path, generator: str, up: Up, expected: tuple[Any, Any]) -> None:
    scene = read_scene_file(written(tmp_path, generator=generator), up=up)
    assert np.allclose(bounds(scene), expected, atol=1e-6)
    (camera,) = scene.cameras
    forward = camera.X_world_camera[:3, 2]
    assert np.allclose(forward, (0, 1, 0) if expected is ROTATED else (0, 0, -1), atol=1e-12)


def test_buffers_may_lie_beside_the_scene(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "a b.bin").write_bytes(base64.b64decode(forms.TRIANGLE_URI.split(",")[1]))
    path = written(tmp_path, buffers=[{"byteLength": 36, "uri": "data/a%20b.bin"}])
    assert np.allclose(bounds(read_scene_file(path)), ROTATED, atol=1e-6)


@pytest.mark.parametrize("uri", ["../secret.bin", "link.bin", "data/../../secret.bin"])
def test_nothing_outside_of_its_folder_is_read(tmp_path: Path, uri: str) -> None:
    (tmp_path / "secret.bin").write_bytes(bytes(36))
    folder = tmp_path / "scenes"
    folder.mkdir()
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    with pytest.raises(SceneFileError, match="outside"):
        read_scene_file(written(folder, buffers=[{"byteLength": 36, "uri": uri}]))


def test_a_link_in_a_circle_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "link.bin").symlink_to("link.bin")
    with pytest.raises(SceneFileError, match=r"link\.bin"):
        read_scene_file(written(tmp_path, buffers=[{"byteLength": 36, "uri": "link.bin"}]))


def test_errors_name_the_file(tmp_path: Path) -> None:
    with pytest.raises(SceneFileError, match=r"none\.glb: No such file or directory"):
        read_scene_file(tmp_path / "none.glb")
    broken = tmp_path / "broken.gltf"
    broken.write_text("{")
    with pytest.raises(SceneFileError, match=r"broken\.gltf: "):
        read_scene_file(broken)
    missing = written(tmp_path, buffers=[{"byteLength": 36, "uri": "gone.bin"}])
    with pytest.raises(SceneFileError, match=r"gone\.bin .*No such file"):
        read_scene_file(missing)


@pytest.mark.parametrize(("up", "position", "direction"), [("y", (1, -3, 2), (0, 1, 0)), ("z", (1, 2, 3), (0, 0, -1))])
def test_lights_are_rotated_with_the_scene(
    tmp_path: Path, up: Up, position: tuple[float, ...], direction: tuple[float, ...]
) -> None:
    node = {"translation": [1, 2, 3], "extensions": {"KHR_lights_punctual": {"light": 0}}}
    lights = {"KHR_lights_punctual": {"lights": [{"type": "spot"}]}}
    path = written(tmp_path, nodes=[node], scenes=[{"nodes": [0]}], extensions=lights)
    (light,) = flatten(read_scene_file(path, up=up).root).lights
    assert light.position == pytest.approx(position)
    assert light.direction == pytest.approx(direction)


def test_the_files_that_were_read_are_listed_with_their_digests(tmp_path: Path) -> None:
    (tmp_path / "corners.bin").write_bytes(bytes(36))
    path = written(tmp_path, buffers=[{"byteLength": 36, "uri": "corners.bin"}])
    digests = read_scene_file(path).digests
    expected = {each: hashlib.sha256((tmp_path / each).read_bytes()).hexdigest() for each in (path.name, "corners.bin")}
    assert digests == expected
    assert list(digests) == [path.name, "corners.bin"]


@pytest.mark.parametrize(("generator", "from_drake"), [("VTK", False), ("Drake glTF merger", True), ("other", False)])
def test_documents_of_drake_are_recognised(tmp_path: Path, generator: str, from_drake: bool) -> None:
    scene = read_scene_file(written(tmp_path, generator=generator))
    assert (scene.generator, scene.from_drake) == (generator, from_drake)


VTK_MATERIAL = {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 0.5], "metallicFactor": 0, "roughnessFactor": 1}}


@pytest.mark.parametrize(
    ("generator", "up", "material", "warns", "restored"),
    [
        ("VTK", "auto", VTK_MATERIAL, True, False),
        ("VTK", "y", VTK_MATERIAL, False, False),
        ("VTK", "z", VTK_MATERIAL, False, True),
        ("VTK", "auto", VTK_MATERIAL | {"doubleSided": True}, False, False),
        ("other", "auto", VTK_MATERIAL, False, False),
        ("other", "z", VTK_MATERIAL, False, False),
    ],
)
def test_a_file_that_may_be_a_saved_request_has_a_warning(
    tmp_path: Path, generator: str, up: Up, material: dict[str, Any], warns: bool, restored: bool
) -> None:
    scene = read_scene_file(written(tmp_path, generator=generator, materials=[material]), up=up)
    assert any("--up z --look phong" in warning for warning in scene.warnings) is warns
    (instance,) = flatten(scene.root).instances
    assert instance.material.vtk_export is restored
    assert not scene.from_drake
