"""Loading scenes of each kind, and their description."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from gateway.datasets.scene_sources import find_sources
from gateway.datasets.scenes import LoadedScene, SceneError, load_scene, scene_digest
from gateway.files.robots.reader import read_robot
from gateway.files.robots.scene_files import SceneOptions
from renderers.drawlist import LABEL_NONE
from scenegate.datasets import manifest
from scenegate.warning_text import NOTHING_OF_ROBOT
from tests.datasets.conftest import TREE, loaded
from tests.files.robots.files import ARM, TRIANGLE, visual, write
from tests.support import forms


def labels(scene: LoadedScene) -> list[int]:
    return [instance.label for instance in scene.draw_list.instances]


@pytest.mark.parametrize(
    ("generator", "look", "is_numbered"),
    [("another program", "studio", True), ("VTK", "studio", True), ("Drake glTF merger", "pbr", False)],
)
def test_look_and_labels_follow_the_generator(tmp_path: Path, generator: str, look: str, is_numbered: bool) -> None:
    path = tmp_path / "a.gltf"
    path.write_text(json.dumps(forms.gltf(generator=generator)))
    scene = loaded(path)
    assert scene.look == look
    assert (labels(scene) == [1]) is is_numbered
    assert scene.description.generator == generator
    assert scene.description.labels.keys() == {str(label) for label in labels(scene) if label != LABEL_NONE}
    assert scene.request is None


@pytest.mark.parametrize("name", ["0.bin", "z.bin"])
def test_description_lists_all_files_with_that_of_the_scene_first(tmp_path: Path, name: str) -> None:
    document = forms.gltf(buffers=[{"byteLength": 36, "uri": name}], generator="another program")
    (tmp_path / "a.gltf").write_text(json.dumps(document))
    (tmp_path / name).write_bytes(bytes(36))
    description = loaded(tmp_path / "a.gltf").description
    assert [(file.path, file.sha256) for file in description.sources] == [
        (each, hashlib.sha256((tmp_path / each).read_bytes()).hexdigest()) for each in ("a.gltf", name)
    ]
    assert description.sha256 == scene_digest(description.sources)
    assert (description.scene, description.generator) == ("a.gltf", "another program")


def test_the_digest_depends_on_names_and_contents() -> None:
    files = (manifest.SourceFile("a", "1"), manifest.SourceFile("b", "2"))
    others = (
        files[:1],
        files[::-1],
        (manifest.SourceFile("a", "2"), manifest.SourceFile("b", "1")),
        (manifest.SourceFile("c", "1"), manifest.SourceFile("b", "2")),
    )
    assert scene_digest(files) not in {scene_digest(each) for each in others}
    assert scene_digest(files) == scene_digest(tuple(files))


def test_tree_viewer_requests(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text(json.dumps(TREE))
    scene = loaded(path)
    assert (labels(scene), scene.look, scene.file_camera) == ([1, 2], "studio", None)
    assert scene.description.labels == {"1": (("robot", "base"),), "2": (("robot", "arm"),)}
    warnings = loaded(path, SceneOptions(up="y", scale=0.001)).description.warnings
    assert [warning.split()[0] for warning in warnings] == ["--up", "--scale"]
    path.write_text("{}")
    with pytest.raises(SceneError, match=r"setgeometry .*settransform"):
        loaded(path)


def test_meshes_of_tree_viewer_requests_are_beside_them(tmp_path: Path, scenes: Path) -> None:
    facet = scenes / "deep" / "mesh.stl"
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "t.stl").write_bytes(facet.read_bytes())
    geometry = {"type": "mesh_file", "filename": "meshes/t.stl", "scale": [2, 3, 4]}
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"setgeometry": [{"path": ["m"], "geometry": geometry}]}))
    (instance,) = loaded(path).draw_list.instances
    assert instance.X_world_mesh.diagonal().tolist() == [2.0, 3.0, 4.0, 1.0]


def test_lights_of_meshes_of_a_tree_shine_and_are_described(tmp_path: Path) -> None:
    light = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 3}]}}
    nodes = [{"translation": [1, 2, 3], "extensions": {"KHR_lights_punctual": {"light": 0}}}]
    (tmp_path / "lamp.gltf").write_text(json.dumps(forms.gltf(generator="other", nodes=nodes, extensions=light)))
    geometry = {"type": "mesh_file", "filename": "lamp.gltf"}
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"setgeometry": [{"path": ["lamp"], "geometry": geometry}]}))
    scene = loaded(path)
    assert [light.position for light in scene.draw_list.lights] == [(1, -3, 2)]
    assert [(light.kind, light.intensity) for light in scene.description.lights] == [("point", 3)]
    assert (scene.objects, scene.description.warnings) == ((), ())


def test_recorded_requests_are_read_without_their_scene(tmp_path: Path) -> None:
    path = tmp_path / "a.multipart"
    path.write_bytes(forms.body(forms.gltf(), forms.drake_fields("depth")))
    scene = loaded(path)
    assert scene.request is not None
    assert (scene.request.image_type, scene.look) == ("depth", "pbr")
    assert (labels(scene), scene.description.labels) == ([], {})


def test_errors_do_not_name_the_scene(tmp_path: Path) -> None:
    path = tmp_path / "a.stl"
    path.write_text("no mesh")
    (source,) = find_sources([path])
    path.unlink()
    with pytest.raises(SceneError, match=r"^No such file"):
        load_scene(source)


def test_a_robot_is_posed_by_its_joints_and_has_a_label_for_each_link(tmp_path: Path) -> None:
    scene = loaded(write(tmp_path, ARM), SceneOptions(joints=("shoulder=1.5",)))
    assert scene.look == "studio"
    assert scene.description.labels == {"1": (("arm", "base"),), "2": (("arm", "upper"),)}
    assert [file.path for file in scene.description.sources] == ["robot.urdf"]
    expected = read_robot(tmp_path / "robot.urdf").tree({"shoulder": 1.5}).world_matrix(("arm", "upper"))
    np.testing.assert_array_equal(scene.root.world_matrix(("arm", "upper")), expected)
    with pytest.raises(SceneError, match=r"'sholder'.* shoulder"):
        loaded(tmp_path / "robot.urdf", SceneOptions(joints=("sholder=1",)))


def test_files_of_robots_are_found_below_roots(tmp_path: Path) -> None:
    write(tmp_path / "packages" / "pkg", TRIANGLE, "m.obj")
    robot = write(tmp_path / "a" / "b", visual('<mesh filename="package://pkg/m.obj"/>'))
    warning, nothing_drawn = loaded(robot).description.warnings
    assert nothing_drawn == NOTHING_OF_ROBOT
    assert warning.startswith("link 'a': the mesh package://pkg/m.obj is not shown: the package 'pkg' is not")
    scene = loaded(robot, SceneOptions(roots=(str(tmp_path / "packages"),)))
    assert [file.path for file in scene.description.sources] == ["robot.urdf", "../../packages/pkg/m.obj"]
