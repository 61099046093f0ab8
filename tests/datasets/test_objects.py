"""Objects of scenes: which nodes they are, their frames and models."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import trimesh

from gateway.datasets.annotated_scene import AnnotatedScene, annotate_scene, make_model
from gateway.datasets.classes import classes_of_models, read_classes
from gateway.datasets.objects import SceneObject, joined_objects, object_frame, objects_of, owner_numbers
from gateway.datasets.scene_sources import find_sources
from gateway.datasets.scenes import LoadedScene, load_scene, model_names
from gateway.files.robots.scene_files import SceneOptions
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node
from gateway.scene.tree.transforms import IDENTITY, scaling, translation
from renderers.drawlist import Light, LightKind, Material
from scenegate.messages.geometry import Box
from tests.datasets.conftest import loaded, named
from tests.datasets.plates import Plate, write_plates
from tests.files.gltf.builder import Builder

LINK = '<link name="{}"><visual><geometry><box size="1 1 1"/></geometry></visual></link>'
JOINT = '<joint name="to {}" type="fixed"><parent link="base"/><child link="{}"/></joint>'


def annotated(scene: LoadedScene, files: dict[str, bytes] | None = None) -> AnnotatedScene:
    """Annotate all objects of a scene; ``files`` gets the models."""
    saved = {} if files is None else files
    classes = classes_of_models(each.model for each in scene.objects)
    return annotate_scene(scene, classes, lambda record, data: saved.__setitem__(record.path, data))


def test_objects_of_each_kind_of_scene(scenes: Path) -> None:
    links = LINK.format("base") + LINK.format("tip") + '<link name="frame"/>'
    joints = "".join(JOINT.format(name, name) for name in ("tip", "frame"))
    (scenes / "arm.urdf").write_text(f'<robot name="arm">{links}{joints}</robot>')
    found = {source.name: load_scene(source).objects for source in find_sources([scenes])}
    assert found["arm.urdf"] == tuple(SceneObject(("arm", name), f"arm/{name}") for name in ("base", "tip"))
    assert found["deep/mesh.stl"] == (SceneObject(("mesh",), "mesh"),)
    assert [each.model for each in found["robot.tree.json"]] == ["robot/base", "robot/arm"]
    assert found["depth.multipart"] == ()
    assert len(found["a.gltf"]) == 1


def test_names_of_models_are_known_without_loading(scenes: Path, tmp_path: Path) -> None:
    write_plates(scenes / "plates.gltf", [Plate("1", mesh="a"), Plate("2", mesh="b"), Plate("3", mesh="a")])
    (scenes / "broken.glb").write_bytes(b"glTF")
    (scenes / "broken.stl").write_bytes(b"")
    for source in find_sources([scenes]):
        names = model_names(source)
        if source.name.startswith("broken"):
            assert not names
        else:
            assert names == {each.model for each in load_scene(source).objects}


def test_meshes_of_a_gltf_file_name_the_models() -> None:
    """Equal names are numbered, and a mesh without one is called after its first node."""
    b = Builder()
    for name in ("cup", "cup", "", ""):
        mesh = b.triangle()
        b.json["meshes"][-1] |= {"name": name} if name else {}
        b.node(name=f"node of {mesh}" if mesh == 2 else "", mesh=mesh)
    b.node(mesh=0, name="again")
    assert list(b.read().models.values()) == ["cup", "cup#2", "node of 2", "mesh3", "cup"]


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (2.0, 0.5, 3.0), (-1.0, 1.0, 1.0), (1.0, -2.0, 1.0)])
def test_poses_equal_those_of_trimesh(tmp_path: Path, scale: tuple[float, float, float]) -> None:
    rng = np.random.default_rng(2)
    quaternions = rng.normal(size=(2, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    b = Builder()
    b.json["scenes"] = [{"nodes": [0]}]
    b.node(name="parent", rotation=quaternions[0].tolist(), translation=[1.0, 2.0, 3.0], children=[1], scale=[2.0] * 3)
    b.node(name="child", rotation=quaternions[1].tolist(), translation=[0.1, 0.2, 0.3], scale=scale, mesh=b.triangle())
    path = tmp_path / "scene.gltf"
    path.write_bytes(b.text())
    files: dict[str, bytes] = {}
    scene = annotated(loaded(path), files)
    (each,) = scene.objects
    reference = trimesh.load_scene(path)
    X_document_node, geometry = reference.graph.get("child")
    X_world_node = np.array(((1, 0, 0, 0), (0, 0, -1, 0), (0, 1, 0, 0), (0, 0, 0, 1))) @ X_document_node
    X, scale = each.object_frame.X_world_object, each.object_frame.scale
    np.testing.assert_allclose(X @ np.diag((*scale, 1.0)), X_world_node, atol=1e-6)
    rotation = X[:3, :3]
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) > 0.0
    (data,) = files.values()
    model = trimesh.load_mesh(trimesh.util.wrap_as_stream(data), file_type="ply", process=False)
    np.testing.assert_allclose(model.vertices, reference.geometry[geometry].vertices, atol=1e-6)
    inside = model.vertices * scale
    np.testing.assert_allclose(each.box, (inside.min(axis=0), inside.max(axis=0)), atol=1e-6)


def test_shear_becomes_part_of_the_model() -> None:
    turned = np.eye(4)
    turned[:2, :2] = ((0.6, -0.8), (0.8, 0.6))
    X = translation(1.0, 2.0, 3.0) @ scaling(1.0, 3.0, 1.0) @ turned
    frame = object_frame(X)
    assert frame is not None
    assert frame.scale == (1.0, 1.0, 1.0)
    rotation = frame.X_world_object[:3, :3]
    np.testing.assert_allclose(rotation.T @ rotation, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(frame.X_world_object @ frame.X_model_node, X, atol=1e-12)


@pytest.mark.parametrize("matrix", [scaling(1.0, 0.0, 1.0), np.full((4, 4), np.nan), np.ones((4, 4))])
def test_flat_nodes_have_no_frame(matrix: np.ndarray) -> None:
    assert object_frame(matrix) is None


def test_flat_and_hidden_nodes_are_not_annotated(scenes: Path) -> None:
    box = (Part(Box((1.0, 1.0, 1.0)), Material()),)
    nodes: dict[str | int, Node] = {
        "seen": Node(box),
        "flat": Node(box, scaling(1.0, 1.0, 0.0)),
        "hidden": Node(box),
        "empty": Node(()),
        "light": Node((Part(Light(LightKind.POINT), Material()),)),
    }
    nodes["hidden"].visible = False
    root = Node(None, IDENTITY, nodes)
    whole = load_scene(named(scenes, "robot.tree.json"))
    scene = annotated(replace(whole, root=root, draw_list=flatten(root), objects=objects_of(root)))
    assert [each.path for each in scene.objects] == [("seen",)]
    assert scene.instance_of.tolist() == [1, 2, 0]


def test_an_object_owns_its_subtree_without_the_objects_below() -> None:
    box = (Part(Box((1.0, 1.0, 1.0)), Material()),)
    inner = Node(box, translation(0.0, 0.0, 5.0), {"detail": Node(box, translation(1.0, 0.0, 0.0))})
    outer = Node(None, IDENTITY, {"shell": Node(box), "inner": inner, "lid": Node(box, translation(0.0, 2.0, 0.0))})
    root = Node(None, IDENTITY, {"outer": outer, "floor": Node(box)})
    assert [each.path for each in objects_of(root)][:2] == [("outer", "shell"), ("outer", "inner")]
    owners = owner_numbers(root, {("outer",): 1, ("outer", "inner"): 2})
    assert owners.tolist() == [1, 2, 2, 1, 0]
    assert owner_numbers(root, {("outer",): 1, ("outer", "inner"): 0}).tolist() == [1, 0, 0, 1, 0]


def test_whole_nodes_are_one_object() -> None:
    """The topmost node that matches; a node with a mesh of its own, too."""
    paths = [("cell", "arm"), ("cell", "arm", "hand"), ("cell", "arm", "hand", "tip"), ("cell", "ball", "a"), ("wall",)]
    objects = tuple(SceneObject(path, f"model of {path[-1]}") for path in paths)
    assert joined_objects(objects, lambda path: False) == objects
    joined = joined_objects(objects, lambda path: path[-1] in ("arm", "hand", "ball"))
    assert joined == (objects[0], SceneObject(("cell", "ball"), "ball"), objects[4])


def test_a_whole_robot_has_one_pose_and_model(scenes: Path) -> None:
    links = LINK.format("base") + LINK.format("tip").replace("<geometry>", '<origin xyz="2 0 0"/><geometry>')
    (scenes / "arm.urdf").write_text(f'<robot name="arm">{links}{JOINT.format("tip", "tip")}</robot>')
    file = scenes / "classes.toml"
    file.write_text('[[class]]\nname = "robot"\npath = "arm"\nwhole = true')
    (each,) = annotate_scene(loaded(scenes / "arm.urdf"), read_classes(file)[0], lambda record, data: None).objects
    assert (each.path, each.model, each.class_id) == (("arm",), "arm", 1)
    np.testing.assert_allclose(each.box, ((-0.5, -0.5, -0.5), (2.5, 0.5, 0.5)))
    assert len(each.draw_list.instances) == 2


def test_models_of_one_name_and_other_geometry_get_other_names(tmp_path: Path) -> None:
    """A sheared plate is another model; plates that only have other poses share one."""
    parent = {"rotation": [0.0, 0.0, np.sin(0.3), np.cos(0.3)]}
    b = Builder()
    b.json["scenes"] = [{"nodes": [0, 2, 3]}]
    mesh = b.triangle()
    b.json["meshes"][0]["name"] = "m"
    b.node(name="squashed", scale=[1.0, 3.0, 1.0], children=[1])
    b.node(name="sheared", mesh=mesh, **parent)
    b.node(name="plain", mesh=mesh)
    b.node(name="moved", mesh=mesh, translation=[1.0, 0.0, 0.0], scale=[2.0, 2.0, 2.0])
    path = tmp_path / "scene.gltf"
    path.write_bytes(b.text())
    files: dict[str, bytes] = {}
    scene = annotated(loaded(path), files)
    models = {each.path[-1]: each.model for each in scene.objects}
    assert models == {"sheared": "m", "plain": "m#2", "moved": "m#2"}
    assert scene.models.keys() == {"m", "m#2"}
    assert len(files) == 2


def test_a_mirrored_part_keeps_its_front() -> None:
    box = Node(None, IDENTITY, {"b": Node((Part(Box((1.0, 2.0, 3.0)), Material()),), scaling(-1.0, 1.0, 1.0))})
    model = make_model(flatten(box).instances, IDENTITY)
    assert model is not None
    record, data = model
    mesh = trimesh.load_mesh(trimesh.util.wrap_as_stream(data), file_type="ply")
    assert mesh.volume == pytest.approx(6.0)
    assert record.box == ((-0.5, -1.0, -1.5), (0.5, 1.0, 1.5))


@pytest.mark.parametrize("up", ["y", "z"])
def test_objects_of_drakes_files_are_those_of_the_tree(scenes: Path, up: Literal["y", "z"]) -> None:
    scene = load_scene(named(scenes, "a.gltf"), SceneOptions(up=up))
    assert len(annotated(scene).objects) == len(scene.objects) == 1
