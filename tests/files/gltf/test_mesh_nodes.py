"""Skins, morph targets and instances: the nodes of a document pose its meshes."""

import re
import tracemalloc
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.files.gltf import GltfCache, GltfError, GltfLimits, GltfScene
from gateway.scene.draw.flatten import flatten
from tests.files.gltf.builder import Builder, mesh_of, meshes, parts, read_file, world_triangles

STRIP = np.array([(x, y, 0.0) for y in range(4) for x in range(2)], np.float32)
"""Vertices of three quads that lie above each other."""
QUADS = np.array([(k, k + 1, k + 2, k + 2, k + 1, k + 3) for k in (0, 2, 4)]).ravel()
JOINTS = np.array([(1, 0, 2, 0)] * 8)
WEIGHTS = np.array([(k // 2 / 3, 1 - k // 2 / 3, 0, 0) for k in range(8)], np.float32)


def matrix(translation: Any = (0, 0, 0), angle: float = 0.0, scale: Any = (1, 1, 1)) -> NDArray[np.float64]:
    """Translation, rotation about z, scale."""
    X = np.eye(4)
    cos, sin = np.cos(angle), np.sin(angle)
    X[:3, :3] = np.array([(cos, -sin, 0), (sin, cos, 0), (0, 0, 1)]) * scale
    X[:3, 3] = translation
    return X


def column_major(X: NDArray[np.float64]) -> list[float]:
    values: list[float] = X.T.ravel().tolist()
    return values


BONES = [matrix((0.5, 0, 0), 0.2), matrix((0, 1, 0), 0.7, (1, 2, 1)), matrix((3, 0, 1))]
"""Poses of three joints; the second is a child of the first."""
BINDS = [matrix((-0.5, 0, 0)), matrix((-0.5, -1, 0)), matrix()]


def skinned(**node: Any) -> Builder:
    """A strip that three joints bend; node 0 has the mesh, nodes 1 to 3 are the joints."""
    b = Builder()
    attributes = {
        "POSITION": b.accessor(STRIP),
        "NORMAL": b.accessor(np.tile([0.0, 0.6, 0.8], (8, 1))),
        "TANGENT": b.accessor(np.tile([1.0, 0.0, 0.0, -1.0], (8, 1))),
        "JOINTS_0": b.accessor(JOINTS, "B"),
        "WEIGHTS_0": b.accessor(WEIGHTS),
    }
    mesh = b.mesh({"attributes": attributes, "indices": b.accessor(QUADS, "H")})
    binds = b.accessor(np.stack([X.T.ravel() for X in BINDS]).astype(np.float32))
    b.add("skins", {"joints": [1, 2, 3], "inverseBindMatrices": binds})
    b.node(mesh=mesh, skin=0, **node)
    b.node(matrix=column_major(BONES[0]), children=[2])
    b.node(matrix=column_major(BONES[1]))
    b.node(matrix=column_major(BONES[2]))
    b.json["scenes"] = [{"nodes": [0, 1, 3]}]
    return b


def bent(joints: Any = JOINTS, weights: Any = WEIGHTS, positions: Any = STRIP) -> NDArray[np.float64]:
    """Positions of the strip's vertices by the formula of glTF 2.0, section 3.7.3.3, in a loop."""
    world = [BONES[0], BONES[0] @ BONES[1], BONES[2]]
    result = []
    for position, joint, weight in zip(positions, joints, weights, strict=True):
        X = sum((w * world[j] @ BINDS[j] for j, w in zip(joint, weight, strict=True)), np.zeros((4, 4)))
        result.append((X / np.sum(weight) @ (*position, 1.0))[:3])
    return np.array(result)


def assert_drawn(scene: GltfScene, vertices: Any) -> None:
    """The strip is the only mesh, and its vertices are there."""
    (triangles,) = world_triangles(scene)
    np.testing.assert_allclose(triangles, vertices[QUADS.reshape(-1, 3)], rtol=0, atol=1e-5)


def attributes(b: Builder) -> dict[str, Any]:
    found: dict[str, Any] = b.json["meshes"][0]["primitives"][0]["attributes"]
    return found


@pytest.mark.parametrize("node", [{}, {"translation": [7, 8, 9], "scale": [0, 0, 0]}])
def test_a_skin_bends_its_mesh_and_the_transform_of_its_node_does_not_apply(node: dict[str, Any]) -> None:
    assert_drawn(skinned(**node).read(), bent())


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1)])
def test_a_mirrored_skin_shows_its_front(scale: Any) -> None:
    """Triangles of mirrored instances run the other way round."""
    b = skinned()
    b.node(scale=scale, children=[0, 1, 3])
    b.json["scenes"] = [{"nodes": [4]}]
    scene = b.read()
    assert_drawn(scene, bent() * scale)
    (triangles,) = world_triangles(scene)
    (instance,) = flatten(scene.root).instances
    mirror = np.sign(np.linalg.det(instance.X_world_mesh[:3, :3]))
    fronts = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) * mirror
    assert (fronts[:, 2] > 0).all()
    (mesh,) = meshes(scene)
    normals = np.asarray(mesh.normals, np.float64) @ np.linalg.inv(instance.X_world_mesh[:3, :3])
    assert np.allclose(normals[0], (-0.6 * np.sin(0.2) * scale[0], 0.6 * np.cos(0.2), 0.8), atol=1e-6)


def test_directions_follow_the_joints_at_unit_length() -> None:
    (mesh,) = meshes(skinned().read())
    assert np.abs(np.linalg.norm(mesh.normals, axis=1) - 1).max() < 1e-6
    # The first vertices follow joint 0 alone: a rotation by 0.2.
    assert np.allclose(mesh.normals[0], (-0.6 * np.sin(0.2), 0.6 * np.cos(0.2), 0.8), atol=1e-6)
    assert np.allclose(mesh.tangents[0], (np.cos(0.2), np.sin(0.2), 0, -1), atol=1e-6)


def test_weights_are_normalized() -> None:
    b = skinned()
    attributes(b)["WEIGHTS_0"] = b.accessor(WEIGHTS * np.arange(1, 9)[:, None])
    assert_drawn(b.read(), bent())


def test_vertices_without_weights_follow_their_first_joint() -> None:
    b = skinned()
    attributes(b)["WEIGHTS_0"] = b.accessor(np.zeros((8, 4)))
    scene = b.read()
    sentence = "meshes[0].primitives[0]: 8 of 8 vertices have no weights, they follow their first joint"
    assert scene.warnings == (sentence,)
    assert_drawn(scene, bent(weights=np.tile([1.0, 0, 0, 0], (8, 1))))


def test_eight_joints_a_vertex() -> None:
    b = skinned()
    attributes(b)["WEIGHTS_0"] = b.accessor(WEIGHTS * 0.75)
    attributes(b)["JOINTS_1"] = b.accessor(np.full((8, 4), 2), "H")
    attributes(b)["WEIGHTS_1"] = b.accessor(np.tile([0, 0, 51, 13], (8, 1)), "B", normalized=True)
    weights = np.hstack((WEIGHTS * 0.75, np.tile([0, 0, 51 / 255, 13 / 255], (8, 1))))
    assert_drawn(b.read(), bent(np.hstack((JOINTS, np.full((8, 4), 2))), weights))


def test_a_skin_without_inverse_bind_matrices_and_a_primitive_without_joints() -> None:
    b = skinned()
    del b.json["skins"][0]["inverseBindMatrices"]
    b.json["nodes"][1] = {"translation": [1, 2, 3]}
    b.json["nodes"][0]["skin"] = b.add("skins", {"joints": [1]})
    attributes(b)["JOINTS_0"] = b.accessor(np.zeros((8, 4)), "B")
    b.json["scenes"] = [{"nodes": [0, 1]}]
    assert_drawn(b.read(), STRIP + np.array((1, 2, 3)))


def test_far_from_the_origin_bends_are_exact() -> None:
    b = skinned()
    b.node(translation=[1e6, 2e6, 0], children=[1, 3])
    b.json["scenes"] = [{"nodes": [0, 4]}]
    (triangles,) = world_triangles(b.read())
    assert np.abs(triangles - (1e6, 2e6, 0) - bent()[QUADS.reshape(-1, 3)]).max() < 1e-5


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda b: b.json["nodes"][0].update(skin=4), r"nodes\[0\]\.skin: 4 is out of range \(1 skins\)"),
        (lambda b: b.json["skins"][0].update(joints=[1, 9]), r"skins\[0\]\.joints\[1\]: nodes\[9\] is not part of"),
        (lambda b: b.json["skins"][0].update(joints=[1, 2, 1]), r"skins\[0\]\.joints: a node is there twice"),
        (lambda b: b.json["skins"][0].update(joints=[]), r"skins\[0\]\.joints: there are none"),
        (lambda b: b.json["skins"][0].update(inverseBindMatrices=0), r"inverseBindMatrices: accessors\[0\]"),
        (
            lambda b: b.json["accessors"][5].update(count=2),
            r"skins\[0\]\.inverseBindMatrices: accessors\[5\] does not have 3 float matrices",
        ),
    ],
)
def test_a_skin_that_cannot_be_read_leaves_the_mesh_at_rest(change: Any, message: str) -> None:
    b = skinned_with_matrices()
    change(b)
    scene = b.read()
    assert scene.instance_count == 1
    assert re.search(message, scene.warnings[0])
    assert scene.warnings[0].endswith("; nodes[0] is drawn at rest and once")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda b: b.json["skins"][0].update(joints=[1, 2]), r"\[0\]: a vertex follows joint 2 of a skin with 2"),
        (
            lambda b: b.json["accessors"][3].update(componentType=5120),
            r"attributes\.JOINTS_0: accessors\[3\] does not have unsigned integers of 8 or 16 bits",
        ),
    ],
)
def test_errors_of_skinned_vertices(change: Any, message: str) -> None:
    b = skinned_with_matrices()
    change(b)
    with pytest.raises(GltfError, match=message):
        b.read()


def skinned_with_matrices() -> Builder:
    b = skinned()
    b.json["accessors"][5], b.json["accessors"][6] = b.json["accessors"][6], b.json["accessors"][5]
    b.json["skins"][0]["inverseBindMatrices"] = 5
    b.json["meshes"][0]["primitives"][0]["indices"] = 6
    return b


def test_a_morphed_skin() -> None:
    b = skinned(weights=[2.0])
    up = b.accessor(np.tile([0.0, 0.0, 0.5], (8, 1)))
    targets = [{"POSITION": up, "JOINTS_0": 0, "WEIGHTS_0": 0}]  # joints cannot be morphed
    b.json["meshes"][0]["primitives"][0]["targets"] = targets
    assert_drawn(b.read(), bent(positions=STRIP + np.array((0, 0, 1))))


def test_more_joints_than_supported() -> None:
    b = skinned()
    given = attributes(b)
    for n in range(1, 5):
        assert b.read().warnings == ()
        given |= {f"JOINTS_{n}": given["JOINTS_0"], f"WEIGHTS_{n}": given["WEIGHTS_0"]}
    with pytest.raises(GltfError, match=r"JOINTS_4: .* 16 "):
        b.read()


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1)])
def test_a_skin_is_read_once_for_all_of_its_nodes(scale: Any) -> None:
    """Otherwise a small document could use gigabytes."""
    b = skinned()
    first = len(b.json["nodes"])
    binds = b.accessor(np.tile(np.eye(4).ravel(), (500, 1)))
    b.json["skins"].append({"joints": [b.node() for _ in range(500)], "inverseBindMatrices": binds})
    nodes = [b.node(mesh=0, skin=1, scale=scale) for _ in range(500)]
    b.json["scenes"] = [{"nodes": [*range(first, first + 500), *nodes]}]
    tracemalloc.start()
    scene = b.read()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert scene.instance_count == 500
    assert peak < 5e6  # a matrix for each joint and node would take 12 MB


def morphed(weights: Any, mesh_weights: Any = None) -> Builder:
    b = Builder()
    up = {"POSITION": b.accessor(np.tile([0.0, 0, 1], (8, 1))), "NORMAL": b.accessor(np.tile([1.0, 0, -1], (8, 1)))}
    wide = {"POSITION": b.accessor(STRIP * (1, 0, 0)), "TEXCOORD_0": None, "TANGENT": 0, "COLOR_0": 77, "JOINTS_0": 0}
    b.draw(STRIP, QUADS, NORMAL=np.tile([0.0, 0, 1], (8, 1)), targets=[up, wide])
    b.json["nodes"][0] |= {"translation": [0, 0, 5], "weights": weights}
    b.json["meshes"][0]["weights"] = mesh_weights
    return b


@pytest.mark.parametrize(
    ("weights", "mesh_weights", "up", "wide"),
    [
        ([0.5, 2.0], None, 0.5, 2.0),
        (None, [0.5, 2.0], 0.5, 2.0),
        ([1.0, 0.0], [0.5, 2.0], 1.0, 0.0),
        ([0.25], [1.0, 1.0], 0.25, 0.0),
        ([], [1.0, 1.0], 0.0, 0.0),
        ([-1.0, 1.0, 5.0], None, -1.0, 1.0),
        (None, None, 0.0, 0.0),
    ],
)
def test_morph_targets(weights: Any, mesh_weights: Any, up: float, wide: float) -> None:
    scene = morphed(weights, mesh_weights).read()
    assert_drawn(scene, STRIP + (0, 0, 5 + up) + STRIP * (wide, 0, 0))
    (mesh,) = meshes(scene)
    normal = np.array((up, 0, 1 - up))
    assert np.allclose(mesh.normals, normal / np.linalg.norm(normal), atol=1e-6)
    assert scene.warnings == ()


def test_normals_without_a_direction_are_computed_from_deformed_positions() -> None:
    b = morphed([0.0, 0.0])
    primitive = b.json["meshes"][0]["primitives"][0]
    primitive["attributes"]["NORMAL"] = b.accessor([(0, 0, 0)] * 7 + [(0, 0, 1)])
    primitive["targets"] = [{"POSITION": b.accessor(STRIP[:, (2, 2, 0)])}]  # z = x: a slope of 45 degrees
    b.json["nodes"][0]["weights"] = [1.0]
    (mesh,) = meshes(b.read())
    assert np.allclose(mesh.normals[:7], (-np.sqrt(0.5), 0, np.sqrt(0.5)), atol=1e-6)


def test_an_attribute_of_a_target_that_does_not_fit_is_ignored() -> None:
    b = morphed([1.0, 0.0])
    b.json["accessors"][1]["count"] = 7
    scene = b.read()
    assert scene.instance_count == 1
    path = "meshes[0].primitives[0].targets[0].NORMAL"
    assert scene.warnings == (f"{path}: accessors[1] has 7 values of 3 components, not 8 of 3; {path} is ignored",)


def test_morphed_vertices_that_are_not_finite_are_left_out() -> None:
    b = morphed([1.0, 0.0])
    b.json["accessors"][1]["count"] = 8
    b.json["nodes"][0]["weights"] = [float(2**200), 0.0]
    assert b.read().instance_count == 0  # nothing finite remains
    assert "not finite" in b.read().warnings[0]


def test_only_the_part_in_use_of_a_shared_buffer_is_deformed() -> None:
    b = morphed([1.0, 1.0])
    b.json["meshes"][0]["primitives"][0]["indices"] = b.accessor([5, 6, 7], "B")
    (triangles,) = world_triangles(b.read())
    assert np.allclose(triangles[0], (STRIP + (0, 0, 6) + STRIP * (1, 0, 0))[5:8])
    assert len(meshes(b.read())[0].positions) == 3


def test_equal_poses_share_a_mesh_and_others_do_not() -> None:
    b = morphed([1.0, 0.0])
    for weights in ([1.0, 0.0], [0.5, 0.0]):
        b.node(mesh=0, weights=weights)
    cache = GltfCache()
    one, two, other = meshes(b.read(cache=cache))
    assert one is two
    assert other is not one
    assert meshes(b.read(cache=cache))[0] is one
    b.json["nodes"][0]["weights"] = [0.25, 0.0]
    assert meshes(b.read(cache=cache))[0] is not one


@pytest.mark.parametrize("name", ["posed", "instanced"])
def test_cached_documents_follow_their_nodes(name: str) -> None:
    b = morphed([1.0, 0.0])
    b.json["asset"]["extras"] = "long enough to be kept " * 300
    t = b.accessor(np.eye(3))
    extension = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": t}}}
    cache = GltfCache()
    for x in range(4):
        for plain in (True, False):
            node: dict[str, Any] = {"mesh": 0, "translation": [x, 0, 0]}
            if not plain:
                node |= {"weights": [x, 1.0]} if name == "posed" else {"extensions": extension}
            b.json["nodes"] = [node]
            document = {key: b.json[key] for key in sorted(b.json, key=lambda key: (key == "nodes", key))}
            b.json = document
            ours, expected = world_triangles(b.read(cache=cache)), world_triangles(b.read())
            assert len(ours) == len(expected) == (1 if plain or name == "posed" else 3)
            assert all((a == c).all() for a, c in zip(ours, expected, strict=True))


def instanced(attributes: dict[str, int], b: Builder, **node: Any) -> Builder:
    extensions = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    b.json["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    b.node(mesh=b.triangle(), extensions=extensions, **node)
    return b


def test_instances() -> None:
    b = Builder()
    half = np.sqrt(0.5)
    attributes = {
        "TRANSLATION": b.accessor([(1, 2, 3), (4, 5, 6)]),
        "ROTATION": b.accessor([(0, 0, 0, 127), (0, 0, round(half * 127), round(half * 127))], "b", normalized=True),
        "SCALE": b.accessor([(1, 1, 1), (2, 3, 4)]),
        "_ID": b.accessor([1, 2]),
    }
    scene = instanced(attributes, b, translation=[10, 0, 0], name="tree").read()
    first, second = world_triangles(scene)
    assert np.allclose(first[0], [(11, 2, 3), (12, 2, 3), (11, 3, 3)], atol=0.02)
    assert np.allclose(second[0], [(14, 5, 6), (14, 7, 6), (11, 5, 6)], atol=0.02)
    (one, two) = (mesh_of(part) for _, part in parts(scene))
    assert one is two
    assert [path for path, _ in parts(scene)] == [("tree", "tree"), ("tree", "tree#2")]
    assert scene.instance_count == 2


@pytest.mark.parametrize(
    ("colors", "dtype", "expected"),
    [
        ([(1, 0, 0), (0, 0.5, 1), (0, 0.5, 1)], "f", [(1, 0, 0, 1), (0, 0.5, 1, 1), (0, 0.5, 1, 1)]),
        ([(255, 0, 51, 255), (0, 0, 0, 51), (0, 0, 0, 51)], "B", [(1, 0, 0.2, 1), (0, 0, 0, 0.2), (0, 0, 0, 0.2)]),
        ([(65535, 0, 13107)] * 3, "H", [(1, 0, 0.2, 1)] * 3),
    ],
)
@pytest.mark.parametrize("base", [None, (0.5, 1.0, 0.25, 1.0)])
def test_instances_have_their_own_colors(colors: Any, dtype: str, expected: Any, base: Any) -> None:
    b = Builder()
    attributes = {"TRANSLATION": b.accessor(np.eye(3)), "_COLOR_0": b.accessor(colors, dtype, normalized=dtype != "f")}
    instanced(attributes, b)
    if base is not None:
        b.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": base}})
        b.json["meshes"][0]["primitives"][0]["material"] = 0
    materials = [part.material for _, part in parts(b.read())]
    np.testing.assert_allclose([each.base_color for each in materials], np.array(expected) * (base or 1.0), atol=1e-6)
    assert len({id(each) for each in materials}) == len(set(map(tuple, expected)))


@pytest.mark.parametrize("colors", [[(1, 0, 0), (0, 1, 0)], [(1, 0), (0, 1), (1, 1)]])
def test_colors_that_fit_no_instance_have_a_warning(colors: Any) -> None:
    b = Builder()
    scene = instanced({"TRANSLATION": b.accessor(np.eye(3)), "_COLOR_0": b.accessor(colors)}, b).read()
    assert [part.material.base_color for _, part in parts(scene)] == [(1.0, 1.0, 1.0, 1.0)] * 3
    (warning,) = scene.warnings
    assert "_COLOR_0" in warning


def test_an_instanced_file() -> None:
    scene = read_file("instanced")
    assert scene.instance_count == 5
    (rigid,) = world_triangles(read_file("rigid"))
    for i, triangles in enumerate(world_triangles(scene)):
        X = matrix((i, 0.5, -0.5 * i), 2 * 0.1 * i, (1, 1 - 0.1 * i, 1))
        assert np.abs(triangles - (rigid @ X[:3, :3].T + X[:3, 3])).max() < 1e-5


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({}, r"nodes\[0\]\.extensions\.EXT_mesh_gpu_instancing\.attributes: no TRANSLATION, ROTATION or SCALE"),
        ({"TRANSLATION": 0, "SCALE": 1}, "or of different lengths"),
        ({"ROTATION": 0}, r"attributes\.ROTATION: accessors\[0\] has 3 components"),
        ({"SCALE": 2}, r"attributes: not finite"),
        ({"SCALE": 9}, r"attributes\.SCALE: 9 is out of range"),
        (
            {"SCALE": "0"},
            r"nodes\[0\]\.extensions\.EXT_mesh_gpu_instancing\.attributes\.SCALE: expected an integer, got \"0\"",
        ),
    ],
)
def test_instances_that_cannot_be_read_are_one(attributes: Any, message: str) -> None:
    b = Builder()
    b.accessor(np.eye(3))
    b.accessor(np.ones((2, 3)))
    b.accessor([(1, np.inf, 1)])
    scene = instanced(attributes, b).read()
    assert scene.instance_count == 1
    assert re.search(message, scene.warnings[0])


def test_instances_are_nodes() -> None:
    b = Builder()
    b = instanced({"TRANSLATION": b.accessor(np.zeros((4, 3)))}, b)
    assert b.read(limits=GltfLimits(max_nodes=5)).instance_count == 4
    with pytest.raises(GltfError, match=r"nodes\[0\]: .*max_nodes = 4"):
        b.read(limits=GltfLimits(max_nodes=4))


def test_the_number_of_instances_is_checked_before_they_are_read() -> None:
    b = Builder()
    b = instanced({"SCALE": b.add("accessors", {"componentType": 5126, "count": 60_000_000, "type": "VEC3"})}, b)
    with pytest.raises(GltfError, match=r"instancing: 60000000 .*max_nodes = 100000"):
        b.read()


def test_documents_that_drake_merged_have_neither_skins_nor_morph_targets() -> None:
    b = Builder("Drake glTF merger")
    mesh = b.triangle()
    b.json["meshes"][mesh]["weights"] = [0.0, 0.0]
    b.json["meshes"][mesh]["primitives"][0]["targets"] = [{"POSITION": 99}]
    b.json["scenes"] = [{"nodes": [b.node(mesh=mesh), b.node(mesh=mesh, skin=0), b.node(skin=0, weights=[1.0])]}]
    assert b.read().warnings == ("nodes: skins are ignored, 1 meshes are drawn as they are stored",)
    b.json["nodes"][0]["weights"] = [1.0, 0.5]
    assert b.read().warnings[1:] == ("weights: morph targets are ignored, 1 meshes are drawn as they are stored",)
