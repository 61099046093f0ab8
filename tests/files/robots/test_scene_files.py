"""Scene files of every format, as --backdrop, --stereo-scene and ``scenegate render`` read them."""

import json
import os
import re
from pathlib import Path

import numpy as np
import pytest

from gateway.files.assets.scene_file import SceneFileError
from gateway.files.gltf import Up
from gateway.files.robots.reader import read_robot
from gateway.files.robots.scene_files import SceneOptions, read_scene
from gateway.scene.draw.flatten import flatten
from renderers.encode import png_rgb
from scenegate import MeshFile
from scenegate.robots.robot_errors import RobotFileError
from tests.files.gltf.builder import Builder
from tests.files.robots.files import ARM, TRIANGLE, link, visual, write
from tests.support import forms
from tests.support.bounds import scene_bounds

REFUSED = re.escape(" (refused: --strict)")


def test_a_robot_is_a_node_for_each_link(tmp_path: Path) -> None:
    path = write(tmp_path, ARM)
    scene = read_scene(path, SceneOptions(joints=("shoulder=0.5",)))
    expected = read_robot(path).link_poses({"shoulder": 0.5})[1]
    X_world_upper = scene.root.world_matrix(("arm", "upper"))
    np.testing.assert_allclose(X_world_upper, expected, atol=1e-15)
    assert list(scene.digests) == ["robot.urdf"]


def test_packages_of_a_robot_are_found_by_the_roots(tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "far/pkg/m.obj")
    mesh = '<visual><geometry><mesh filename="package://pkg/m.obj"/></geometry></visual>'
    path = write(tmp_path, link(mesh), "near/deep/robot.urdf")
    assert "name a folder that contains it with --root" in read_scene(path).warnings[0]
    assert read_scene(path, SceneOptions(roots=(tmp_path / "far",))).root


def test_a_mesh_is_one_node(tmp_path: Path) -> None:
    scene = read_scene(write(tmp_path, TRIANGLE, "m.OBJ"))
    assert len(scene.root.children["m"].parts) == 1
    assert list(scene.digests) == ["m.OBJ"]


@pytest.mark.parametrize(
    ("name", "image"),
    [("../textures/t.png", "textures/t.png"), ("t.png", "materials/textures/t.png"), ("..\\tex%20t.png", "tex t.png")],
)
def test_textures_of_a_mesh_are_found_as_those_of_robots(tmp_path: Path, name: str, image: str) -> None:
    (tmp_path / image).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / image).write_bytes(png_rgb(np.zeros((2, 2, 3), np.uint8)))
    write(tmp_path, f"newmtl a\nmap_Kd {name}\n", "meshes/m.mtl")
    text = "mtllib m.mtl\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"
    path = write(tmp_path, text, "meshes/m.obj")
    scene = read_scene(path, SceneOptions(strict=True))
    (part,) = scene.root.children["m"].parts or ()
    assert part.material.base_color_texture is not None
    assert list(scene.digests) == ["m.obj", "m.mtl", f"../{image}"]
    assert MeshFile.read(path).files[name] == (tmp_path / image).read_bytes()


def test_files_that_a_published_mesh_refers_to(tmp_path: Path) -> None:
    files = {"a.mtl": b"map_Kd -s 2 2 2 t x.png\n", "b.mtl": b"map_Kd\tu.png\n", "t x.png": b"t", "u.png": b"u"}
    for name, data in files.items():
        write(tmp_path, data, name)
    assert MeshFile.read(write(tmp_path, "mtllib a.mtl b.mtl\n", "m.obj")).files == files
    text = "ply\nformat ascii 1.0\ncomment TextureFile t x.png\nend_header\ncomment TextureFile u.png\n"
    assert MeshFile.read(write(tmp_path, text, "m.ply")).files == {"t x.png": b"t"}
    uris = ["C:\\\\Users\\\\me\\\\u.png", "file:///home/me/t%20x.png", "gone/", "gone.png"]
    images = ", ".join(f'{{"uri": "{uri}"}}' for uri in uris)
    sent = MeshFile.read(write(tmp_path, f'{{"images": [{images}]}}', "m.gltf")).files
    assert sent == {"C:\\Users\\me\\u.png": b"u", "file:///home/me/t%20x.png": b"t"}


@pytest.mark.parametrize("folder", [".", "meshes", "meshes/parts"])
def test_textures_are_found_from_a_relative_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, folder: str) -> None:
    (tmp_path / "meshes/parts").mkdir(parents=True)
    (tmp_path / "materials/textures").mkdir(parents=True)
    (tmp_path / "materials/textures/t.png").write_bytes(b"image")
    write(tmp_path, "<init_from>t.png</init_from>", "meshes/m.dae")
    monkeypatch.chdir(tmp_path / folder)
    assert MeshFile.read(os.path.relpath(tmp_path / "meshes/m.dae")).files == {"t.png": b"image"}


def test_gltf_files_have_an_up_axis(tmp_path: Path) -> None:
    path = write(tmp_path, json.dumps(forms.gltf(generator="other")), "s.gltf")
    assert not np.array_equal(read_scene(path).root.matrix, np.eye(4))
    assert np.array_equal(read_scene(path, SceneOptions(up="z")).root.matrix, np.eye(4))


@pytest.mark.parametrize("up", ["auto", "y", "z"])
def test_mesh_files_have_an_up_axis(tmp_path: Path, up: Up) -> None:
    scene = read_scene(write(tmp_path, "v 0 0 0\nv 1 0 0\nv 0 3 0\nf 1 2 3\n", "m.obj"), SceneOptions(up=up))
    bounds = scene_bounds(flatten(scene.root))
    assert np.ptp(bounds, axis=0).tolist() == ([1, 0, 3] if up == "y" else [1, 3, 0])


def test_options_for_another_kind_of_file_are_noted(tmp_path: Path) -> None:
    options = SceneOptions("z", joints=("a=1",), xacro_args=("a:=1",), variant="red", keyframe="home")
    gltf = write(tmp_path, json.dumps(forms.gltf(generator="other")), "s.gltf")
    mesh = write(tmp_path, TRIANGLE, "m.obj")
    robot = write(tmp_path, ARM)
    for path, flags in (
        (gltf, {"--joint", "--xacro-arg", "--keyframe"}),
        (mesh, {"--joint", "--xacro-arg", "--keyframe", "--variant"}),
        (robot, {"--up", "--variant"}),
    ):
        its = options if path is not robot else SceneOptions("z", variant="red")
        assert {note.split()[0] for note in read_scene(path, its).notes if "no effect" in note} == flags
        assert not any("no effect" in note for note in read_scene(path).notes)


def test_all_lengths_of_a_file_are_scaled(tmp_path: Path) -> None:
    light = {"KHR_lights_punctual": {"lights": [{"type": "point", "range": 4.0}]}}
    nodes = [
        {"translation": [0, 0, 1000], "children": [1, 2], "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"mesh": 0},
        {"camera": 0},
    ]
    document = forms.gltf(generator="other", nodes=nodes, extensions=light)
    path = write(tmp_path, json.dumps(document), "s.gltf")
    scene, original = (read_scene(path, SceneOptions("z", scale)) for scale in (0.001, 1.0))
    placed, original_placed = (flatten(each.root).lights[0] for each in (scene, original))
    for scaled_values, values in (
        (scene_bounds(flatten(scene.root)), scene_bounds(flatten(original.root))),
        (scene.cameras[0].X_world_camera[:3, 3], original.cameras[0].X_world_camera[:3, 3]),
        (scene.cameras[0].zfar, original.cameras[0].zfar),
        (placed.position, original_placed.position),
        (placed.range, original_placed.range),
    ):
        assert values is not None
        np.testing.assert_allclose(scaled_values, np.multiply(values, 0.001), atol=1e-9)
    assert np.array_equal(scene.cameras[0].X_world_camera[:3, :3], original.cameras[0].X_world_camera[:3, :3])


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.txt", "", "its suffix is not one of .gltf, .glb, .dae, "),
        ("a.urdf", "<robot>", "no element found|invalid|unclosed|XML"),
        ("a.obj", "", "no triangles or points|cannot be read as OBJ"),
        ("a.gltf", "{", "JSON"),
    ],
)
def test_errors_name_the_file_once(tmp_path: Path, name: str, content: str, reason: str) -> None:
    path = write(tmp_path, content, name)
    with pytest.raises(SceneFileError, match=reason) as caught:
        read_scene(path)
    assert str(caught.value).count(str(path)) == 1


@pytest.mark.parametrize("suffix", [".urdf", ".obj", ".glb"])
def test_a_missing_file_is_an_error(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(SceneFileError, match=rf"none\{suffix}.*No such file"):
        read_scene(tmp_path / f"none{suffix}")


def test_an_unknown_joint_is_an_error(tmp_path: Path) -> None:
    path = write(tmp_path, ARM)
    with pytest.raises(SceneFileError, match=r"robot\.urdf: the robot has no joint 'knee'"):
        read_scene(path, SceneOptions(joints=("knee=1",)))
    with pytest.raises(SceneFileError, match=r"--joint 'knee': .*name=value"):
        read_scene(path, SceneOptions(joints=("knee",)))


@pytest.mark.parametrize(
    ("name", "content", "warning"),
    [
        (
            "a.urdf",
            link('<visual/><visual><geometry><sphere radius="1"/></geometry></visual>'),
            "link 'a', visual 1: it has no shape; it is not shown",
        ),
        ("a.gltf", '{"nodes": [{"scale": "big"}]}', 'nodes[0].scale: expected an array, got "big"; it is ignored'),
    ],
)
def test_strict_refuses_warnings(tmp_path: Path, name: str, content: str, warning: str) -> None:
    path = write(tmp_path, content, name)
    assert read_scene(path).warnings == (warning,)
    with pytest.raises(SceneFileError, match=f"^{path}: {re.escape(warning)}{REFUSED}$"):
        read_scene(path, SceneOptions(strict=True))
    if name == "a.urdf":
        with pytest.raises(RobotFileError, match=f"^{path}: {re.escape(warning)}{REFUSED}$"):
            read_robot(path, strict=True)


@pytest.mark.parametrize("name", ["clearcoat", "sheen", "iridescence", "anisotropy"])
def test_strict_passes_extensions_that_change_only_gloss(tmp_path: Path, name: str) -> None:
    b = Builder()
    b.node(mesh=b.triangle())
    b.json["extensionsUsed"] = [f"KHR_materials_{name}"]
    b.json["materials"] = [{"extensions": {f"KHR_materials_{name}": {}}}]
    mesh = write(tmp_path, b.text(), "m.gltf")
    robot = write(tmp_path, visual('<mesh filename="m.gltf"/>'))
    for path in (mesh, robot):
        scene = read_scene(path, SceneOptions(strict=True))
        assert scene.warnings == ()
        assert name in "".join(scene.notes)
