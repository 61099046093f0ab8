import gc
import json
import weakref
from typing import Any

import numpy as np
import pytest

from gateway.files.gltf import GltfError, read_gltf
from gateway.scene.tree.transforms import IDENTITY, Matrix, from_pose, look_at
from tests.files.gltf.builder import TRIANGLE, Builder, parts, world_triangles

SHIFT = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1]


def from_trs(translation: Any, rotation_xyzw: Any, scale: Any) -> Matrix:
    """Translation * rotation * scale, one node at a time."""
    x, y, z, w = rotation_xyzw
    matrix = from_pose(translation, (w, x, y, z))
    matrix[:3, :3] *= scale
    return matrix


def paths(scene: Any) -> list[tuple[str | int, ...]]:
    return [path for path, _ in scene.root.walk() if path]


def test_matrix_is_column_major_and_identity_is_shared() -> None:
    b = Builder()
    b.node(name="a", matrix=SHIFT, children=[1, 2])
    b.node(name="b", matrix=np.eye(4).ravel().tolist())
    b.node(name="c")
    root = b.read().root
    a = root.children["a"]
    assert a.matrix[:3, 3].tolist() == [1, 2, 3]
    assert a.children["b"].matrix is IDENTITY
    assert a.children["c"].matrix is IDENTITY
    assert root.matrix is IDENTITY


def test_translation_rotation_scale() -> None:
    b = Builder()
    half = np.sqrt(0.5)
    b.node(name="a", translation=[1, 2, 3], rotation=[0, 0, half, half], scale=[2, -3, 4])
    X = b.read().root.children["a"].matrix
    np.testing.assert_allclose(X @ (1, 0, 0, 1), (1, 4, 3, 1), atol=1e-12)  # 2 x turned onto y
    np.testing.assert_allclose(X @ (0, 1, 0, 1), (4, 2, 3, 1), atol=1e-12)  # -3 y turned onto 3 x
    assert np.linalg.det(X[:3, :3]) < 0


def test_names_become_unique_path_elements() -> None:
    b = Builder()
    for name in ("arm", "arm", "arm#2", "arm", None, "", "a/b"):
        b.node(**({} if name is None else {"name": name}))
    assert paths(b.read()) == [(n,) for n in ("arm", "arm#2", "arm#2#2", "arm#3", "node4", "node5", "a/b")]


def test_the_order_of_the_document_is_kept() -> None:
    b = Builder()
    b.node(name="r", children=[3, 1])
    b.node(name="x", children=[2])
    b.node(name="y")
    b.node(name="z")
    b.node(name="s")
    assert paths(b.read()) == [("r",), ("r", "z"), ("r", "x"), ("r", "x", "y"), ("s",)]


def test_default_scene() -> None:
    b = Builder()
    for name in "abc":
        b.node(name=name)
    b.json["nodes"][0]["children"] = [1]
    assert paths(b.read()) == [("a",), ("a", "b"), ("c",)]
    b.json["scenes"] = [{"nodes": [2]}, {"nodes": [0]}]
    assert paths(b.read()) == [("c",)]
    b.json["scene"] = 1
    assert paths(b.read()) == [("a",), ("a", "b")]
    for scene, reason in (
        (2, "scene: 2 is out of range (2 scenes)"),
        (-1, "scene: -1 is out of range (2 scenes)"),
        (0, "scenes[0].nodes: expected an array, got 7"),
    ):
        b.json["scene"], b.json["scenes"][0]["nodes"] = scene, 7
        assert paths(read := b.read()) == [("a",), ("a", "b"), ("c",)]
        assert read.warnings == (f"{reason}; all nodes without a parent are drawn",)


EMPTY = ("accessors", "bufferViews", "buffers", "cameras", "images", "materials", "meshes", "nodes")


@pytest.mark.parametrize(
    ("document", "cameras"),
    [
        (b"{}", 0),
        (b'{"asset":{"version":"2.0"},"scene":0}', 0),
        (b'{"scene":0,"cameras":[{"type":"perspective","perspective":{"yfov":0.8,"znear":0.1}}]}', 1),
        (json.dumps(dict.fromkeys(EMPTY) | {"scene": 0, "scenes": [{"name": "Layer 0", "nodes": None}]}).encode(), 0),
        (b'{"asset":null,"scenes":null,"nodes":[null,{"children":null,"mesh":null,"camera":null,"name":null}]}', 0),
        (b'\xef\xbb\xbf \n{"nodes":[]}', 0),
        (b'{"nodes":[{"extras":{"x":NaN,"y":-Infinity}}]}', 0),
    ],
)
def test_almost_empty_documents(document: bytes, cameras: int) -> None:
    """Drake writes null for every empty array, and its acceptance test sends a camera and nothing else."""
    scene = read_gltf(document)
    assert scene.instance_count == 0
    assert len(scene.content.cameras) == cameras
    assert scene.cameras == ()


def test_a_mesh_that_does_not_exist_is_an_error_where_there_is_no_other() -> None:
    with pytest.raises(GltfError, match=r"nodes\[0\]\.mesh: 0 .*\(0 "):
        read_gltf(b'{"nodes": [{"mesh": 0}]}')


@pytest.mark.parametrize(
    ("nodes", "drawn", "warning"),
    [
        ([{"children": [0]}], 1, "nodes[0].children: nodes[0] is already in the scene; it is left out"),
        ([{"children": [1]}, {"children": [0]}], 2, "nodes[1].children: nodes[0] is already"),
        ([{"children": [0]}, {}], 2, "nodes[0].children: nodes[0] is already"),
        ([{"children": [1]}, {"children": [2]}, {"children": [1]}], 3, "nodes[2].children: nodes[1] is already"),
        ([{"children": [2]}, {"children": [2]}, {}], 3, "nodes[1].children: nodes[2] is already in the scene"),
        ([{"children": [1, 1]}, {}], 2, "nodes[0].children: nodes[1] is already in the scene"),
        ([{"children": [1]}], 1, "nodes[0].children: 1 is out of range (1 nodes); it is left out"),
        ([{"children": [-1]}], 1, "nodes[0].children: -1 is out of range (1 nodes)"),
        ([{"children": 3}], 1, "nodes[0].children: expected an array, got 3; it is ignored"),
        ([{"children": [1, "x"]}, {}], 2, 'nodes[0].children[1]: expected an integer, got "x"; it is ignored'),
        ([{}, "x"], 1, 'nodes[1]: expected an object, got "x"; it is left out'),
        ([{"matrix": [1, 2, 3]}], 1, "nodes[0].matrix: 3 numbers instead of 16; it is ignored"),
        ([{"matrix": [None] * 16}], 1, "nodes[0].matrix[0]: expected a finite number, got null; it is ignored"),
        ([{"scale": "big"}], 1, 'nodes[0].scale: expected an array, got "big"; it is ignored'),
        ([{"rotation": [0, 0, 1]}], 1, "nodes[0].rotation: 3 numbers instead of 4; it is ignored"),
        ([{"rotation": [0, 0, 0, 0]}], 1, "nodes[0].rotation: it has no length; the node is not rotated"),
        (
            [{"extensions": {"KHR_node_visibility": 0}}],
            1,
            "nodes[0].extensions.KHR_node_visibility: expected an object",
        ),
    ],
)
def test_flaws_of_a_node_cost_nothing_else(nodes: list[Any], drawn: int, warning: str) -> None:
    b = Builder()
    b.json["nodes"] = nodes
    scene = b.read()
    assert len(scene.nodes.indices) == drawn
    assert (scene.nodes.X_world_node == np.eye(4)).all()
    (found,) = scene.warnings
    assert found.startswith(warning)


def test_a_long_chain_is_drawn_and_its_tree_is_not_as_deep() -> None:
    b = Builder()
    b.json["nodes"] = [{"children": [i + 1], "translation": [1, 0, 0], "name": "link"} for i in range(3000)]
    b.node(mesh=b.triangle(), rotation=[0, 0, 1, 0])
    scene = b.read()
    assert scene.warnings == ()
    assert sum(1 for _ in scene.root.walk()) == 3002
    assert max(len(path) for path, _ in scene.root.walk()) == 256
    (triangle,) = world_triangles(scene)
    np.testing.assert_allclose(triangle, TRIANGLE[None] * (-1, -1, 1) + (3000, 0, 0), atol=1e-3)


def test_hidden_nodes_draw_and_light_nothing() -> None:
    b = Builder()
    mesh = b.triangle()
    b.json["extensionsUsed"] = ["KHR_node_visibility"]
    hidden, shown = ({"KHR_node_visibility": {"visible": visible}} for visible in (False, True))
    light = {"KHR_lights_punctual": {"light": 0}}
    b.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    b.node(name="a", mesh=mesh, extensions={**hidden, **light}, children=[1])
    b.node(name="below a", mesh=mesh, extensions={**shown, **light})
    b.node(name="b", mesh=mesh, extensions={**shown, **light}, children=[3])
    b.node(name="below b", mesh=mesh)
    scene = b.read()
    assert [path for path, _ in parts(scene)] == [("b",), ("b", "below b")]
    assert len(scene.lights) == 1
    assert scene.warnings == ()


def test_instances_share_mesh_and_parts() -> None:
    b = Builder()
    mesh = b.triangle()
    b.node(name="a", mesh=mesh)
    b.node(name="b", mesh=mesh, matrix=SHIFT)
    (first, second) = parts(b.read())
    assert first[0] == ("a",)
    assert first[1] is second[1]


CAMERA = {"type": "perspective", "perspective": {"yfov": 0.8, "znear": 0.01, "zfar": 10, "aspectRatio": 1.5}}


def camera_scene(**node: Any) -> Builder:
    b = Builder("VTK")
    b.add("cameras", CAMERA)
    b.node(name="Renderer Node", children=[1], translation=[0, 0, 1])
    b.node(name="Camera Node", camera=0, **node)
    return b


def test_camera_pose_is_optical() -> None:
    """A glTF camera looks along -Z with +Y up: from above, onto the origin, its optical frame is look_at's."""
    scene = camera_scene(translation=[0, 0, 4]).read()
    camera = scene.camera
    np.testing.assert_allclose(camera.X_world_camera, look_at((0, 0, 5), (0, 0, 0), (0, 1, 0)), atol=1e-12)
    assert (camera.yfov, camera.znear, camera.zfar) == (0.8, 0.01, 10)
    assert camera.name == "Camera Node"
    assert scene.from_drake


def test_a_camera_scale_that_overflows_is_kept() -> None:
    """The square of an axis of 1e300 overflows: the pose is not normalized."""
    b = camera_scene(matrix=[1e300, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1])
    camera = b.read().camera
    assert camera.X_world_camera[0, 0] == 1e300


def test_the_first_node_with_camera_0_counts() -> None:
    b = Builder()
    b.add("cameras", CAMERA)
    b.add("cameras", {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0.1, "zfar": 9}})
    b.node(name="user", camera=1)
    b.node(name="first", camera=0)
    b.node(name="second", camera=0)
    scene = b.read()
    assert [c.name for c in scene.cameras] == ["user", "first", "second"]
    assert scene.camera is scene.cameras[1]
    assert scene.cameras[0].yfov is None
    assert scene.cameras[0].zfar == 9


def test_camera_without_a_node_has_the_identity_pose() -> None:
    scene = read_gltf(b'{"cameras":[{}],"nodes":[{}]}')
    assert scene.cameras == ()
    assert scene.camera.X_world_camera.tolist() == np.diag((1, -1, -1, 1)).tolist()
    camera = scene.camera
    assert (camera.index, camera.name, camera.yfov, camera.znear) == (0, "", None, 0.0)
    assert camera.zfar is None


def test_meshes_without_any_camera() -> None:
    """Drake's client sends this for scenes of glTF meshes only."""
    b = Builder("Drake glTF merger")
    b.node(mesh=b.triangle())
    b.json["cameras"] = None
    scene = b.read()
    assert scene.camera is None
    assert scene.instance_count == 1


@pytest.mark.parametrize("count", [3, 40])
def test_matrices_of_many_nodes(count: int) -> None:
    """Matrices and translations are made for all nodes at once, where there are several of them."""
    rng = np.random.default_rng(count)
    b = Builder()
    expected: list[Any] = []
    for number in range(count):
        x, y, z = rng.normal(size=3).tolist()
        kind = number % 4
        if kind == 0:
            b.node(translation=[x, y, z])
            expected.append(from_trs((x, y, z), (0, 0, 0, 1), (1, 1, 1)))
        elif kind == 1:
            matrix = from_trs((x, y, z), (0.5, 0.5, -0.5, 0.5), (1, 2, 3))
            b.node(matrix=matrix.T.ravel().tolist())
            expected.append(matrix)
        elif kind == 2:
            b.node(translation=[x, y, z], scale=[x, y, z])
            expected.append(from_trs((x, y, z), (0, 0, 0, 1), (x, y, z)))
        else:
            b.node(name="still")
            expected.append(np.eye(4))
    found = [node.matrix for node in b.read().root.children.values()]
    for matrix, wanted in zip(found, expected, strict=True):
        np.testing.assert_array_equal(matrix, wanted)


def test_many_translations_are_checked() -> None:
    b = Builder()
    for number in range(20):
        b.node(translation=[0, 0] if number == 11 else [0, 0, 1])
    scene = b.read()
    assert scene.warnings == ("nodes[11].translation: 2 numbers instead of 3; it is ignored",)
    assert scene.nodes.X_parent_node[:, 2, 3].tolist() == [1.0] * 11 + [0.0] + [1.0] * 8


def test_a_scene_is_freed_without_the_garbage_collector() -> None:
    """A reference cycle would keep megabytes until the next collection."""
    b = camera_scene()
    b.node(mesh=b.triangle())
    scene = b.read()
    assert scene.camera is not None
    (shape,) = {part.shape for _, part in parts(scene)}
    mesh = weakref.ref(shape.mesh)  # type: ignore[union-attr]  # a surface
    gc.disable()
    try:
        del scene, shape
        assert mesh() is None
    finally:
        gc.enable()


@pytest.mark.parametrize(
    ("last_row", "warns"),
    [
        ((1e-6, -1e-6, 0, 1 + 9e-7), False),
        ((2e-6, 0, 0, 1), True),
        ((0, -2e-6, 0, 1), True),
        ((0, 0, 2e-6, 1), True),
        ((0, 0, 0, 1 - 2e-6), True),
    ],
)
def test_the_last_row_of_a_matrix_is_ignored_and_may_have_rounding_errors(last_row: Any, warns: bool) -> None:
    b = Builder()
    columns = np.eye(4)
    columns[3, :3], columns[:, 3] = (5, 6, 7), last_row
    b.node(matrix=columns.ravel().tolist())
    scene = b.read()
    assert scene.nodes.X_parent_node[0].tolist() == [[1, 0, 0, 5], [0, 1, 0, 6], [0, 0, 1, 7], [0, 0, 0, 1]]
    shown = [float(each) for each in last_row]
    assert scene.warnings == ((f"nodes[0].matrix: not affine, its last row {shown} is ignored",) if warns else ())


@pytest.mark.parametrize("value", [-1e13, 1e300])
def test_large_translations_are_kept(value: float) -> None:
    b = Builder()
    b.node(translation=[1, value, -2], children=[1])
    b.node(translation=[0, value, 0], mesh=b.triangle())
    scene = b.read()
    assert scene.nodes.X_world_node[1, :3, 3].tolist() == [1, 2 * value, -2]
    assert scene.nodes.X_parent_node[0, :3, 3].tolist() == [1, value, -2]


def test_a_sheared_camera_keeps_its_axes_at_unit_length() -> None:
    """A scale above a rotation shears: the axes are not orthogonal any more, and each is normalized by itself."""
    b = Builder("VTK")
    b.add("cameras", CAMERA)
    b.node(children=[1], scale=[1, 4, 1], translation=[0, 1, 0])
    b.node(camera=0, rotation=[0, 0, 0.38268343236508984, 0.9238795325112867], translation=[0, 2, 0])
    scene = b.read()
    pose, X = scene.camera.X_world_camera, scene.nodes.X_world_node[1]
    np.testing.assert_allclose(np.linalg.norm(pose[:3, :3], axis=0), 1.0, atol=1e-12)
    assert abs(pose[:3, 0] @ pose[:3, 1]) > 0.5
    np.testing.assert_allclose(pose[:3, 0], X[:3, 0] / np.linalg.norm(X[:3, 0]), atol=1e-12)
    np.testing.assert_allclose(pose[:3, 1], -X[:3, 1] / np.linalg.norm(X[:3, 1]), atol=1e-12)
    assert pose[:3, 3].tolist() == [0, 9, 0]


@pytest.mark.parametrize(("scale", "kept"), [(1 + 1e-13, True), (1 - 1e-13, True), (1 + 1e-11, False)])
def test_rounding_of_a_cameras_axes_is_not_scale(scale: float, kept: bool) -> None:
    camera = camera_scene(matrix=np.diag((1, scale, 1, 1)).ravel().tolist()).read().camera
    assert camera.X_world_camera[1, 1] == (-scale if kept else -1.0)


def test_a_camera_without_extent_keeps_its_pose() -> None:
    camera = camera_scene(scale=[0, 1, 2]).read().camera
    assert np.abs(camera.X_world_camera[:3, :3]).sum(axis=0).tolist() == [0, 1, 2]


def test_defaults_of_cameras() -> None:
    b = Builder()
    sources: list[dict[str, Any]] = [{}, {"perspective": {}}, {"orthographic": {"zfar": 5}}]
    sources.append({"name": "own", "perspective": {"yfov": 1}})
    for camera in sources:
        b.node(name="node", camera=b.add("cameras", camera))
    found = [(c.index, c.name, c.yfov, c.znear, c.zfar) for c in b.read().cameras]
    assert found == [
        (0, "node", None, 0.0, None),
        (1, "node", None, 0.0, None),
        (2, "node", None, 0.0, 5.0),
        (3, "own", 1.0, 0.0, None),
    ]


def test_world_matrices_of_a_deep_chain_are_products_from_the_root_down() -> None:
    b = Builder()
    count = 6
    local = [
        from_trs((k, -k, 0.5 * k), (0.1 * k, 0.2, -0.3, 0.9), (1, -2, 0.5) if k % 2 else (1, 1, 1))
        for k in range(count)
    ]
    for k, matrix in enumerate(local):
        b.node(matrix=matrix.T.ravel().tolist(), **({"children": [k + 1]} if k + 1 < count else {}))
    expected = np.eye(4)
    world = b.read().nodes.X_world_node
    for k, matrix in enumerate(local):
        expected = expected @ matrix
        np.testing.assert_allclose(world[k], expected, rtol=1e-12, atol=1e-9)
        assert world[k, 3].tolist() == [0, 0, 0, 1]
