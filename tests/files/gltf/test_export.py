import io
import json
import math
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.files.gltf import read_gltf
from gateway.files.gltf.export import export_glb
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import Line, Part, PointCloud, Surface
from gateway.scene.tree.nodes import Node, TreeEdit
from gateway.scene.tree.timeline import FileTooLargeError
from renderers.camera import Camera
from renderers.drawlist import (
    AlphaMode,
    DrawList,
    Image,
    ImageError,
    Light,
    LightKind,
    Material,
    Mesh,
    Sampler,
    Texture,
    Topology,
    Wrap,
)
from renderers.encode import png_rgba
from renderers.images import image_from_bytes
from scenegate.messages.geometry import Box, Capsule, Cylinder, Sphere, Triad
from tests.support.bounds import scene_bounds
from tests.support.corpus import corpus_dir

RED = Material(base_color=(1, 0, 0, 1), metallic=0.0, roughness=0.5, double_sided=True)
GLASS = Material(base_color=(0.5, 0.5, 1, 0.25), alpha_mode=AlphaMode.BLEND, metallic=0.0)


def document(glb: bytes) -> dict[str, Any]:
    magic, version, total, length, kind = struct.unpack_from("<4sIIII", glb)
    assert (magic, version, total, kind) == (b"glTF", 2, len(glb), 0x4E4F534A)
    parsed: dict[str, Any] = json.loads(glb[20 : 20 + length])
    return parsed


def scene() -> Node:
    edit = TreeEdit(Node())
    edit.set_matrix((), tf.translation(0, 0, 1))
    edit.set_parts(("robot",), (Part(Box((1, 2, 3)), RED), Part(Sphere(0.5), GLASS, tf.translation(0, 0, 2))))
    edit.set_pose(("robot",), (1, 2, 3, 0.9, 0.1, 0.2, 0.3))
    edit.set_parts(("robot", "arm/1"), (Part(Cylinder(0.1, 1), RED), Part(Capsule(0.1, 1), RED)))
    edit.set_matrix(("robot", "arm/1"), tf.scaling(1, -2, 1))
    edit.set_parts(("robot", 7), (Part(Triad(0.3), RED), Part(Triad(0.3, tube=True), RED)))
    points = np.random.default_rng(1).normal(size=(50, 3)).astype(np.float32)
    edit.set_parts(("cloud",), (Part(PointCloud(points, {"rgb": np.abs(points)}), RED),))
    edit.set_parts(("line",), (Part(Line(points[:5], radius=0), RED), Part(Line(points[:2], end_head=True), RED)))
    return edit.commit()


def soup(drawn: DrawList) -> dict[Topology, np.ndarray]:
    """All element corners in the world by topology, in order of drawing."""
    out: dict[Topology, list[np.ndarray]] = {}
    for instance in drawn.instances:
        mesh, X = instance.mesh, instance.X_world_mesh
        world = mesh.positions.astype(float) @ X[:3, :3].T + X[:3, 3]
        out.setdefault(mesh.topology, []).append(world[mesh.elements].reshape(-1, 3))
    return {topology: np.concatenate(corners) for topology, corners in out.items()}


def reread(root: Node) -> DrawList:
    read = read_gltf(export_glb(root))
    assert not read.from_drake
    assert read.warnings == ()
    return flatten(Node(None, tf.Y_UP_TO_Z_UP, {"file": read.root}))


def sorted_rows(points: np.ndarray) -> np.ndarray:
    rounded = np.round(points, 4) + 0.0
    return points[np.lexsort(rounded.T)]


def test_our_reader_reads_the_same_geometry() -> None:
    root = scene()
    before, after = soup(flatten(root)), soup(reread(root))
    assert before.keys() == after.keys()
    for topology in before:
        np.testing.assert_allclose(sorted_rows(after[topology]), sorted_rows(before[topology]), atol=1e-4)


def test_our_reader_reads_the_same_lights() -> None:
    spot = Light(LightKind.SPOT, (1.0, 0.5, 0.0), 7.0, range=3.0, inner_cone=0.1, outer_cone=0.2)
    edit = TreeEdit(Node())
    for k, light in enumerate((spot, Light(LightKind.POINT), Light(LightKind.DIRECTIONAL, intensity=2.0))):
        edit.set_parts(("lamp", k), (Part(Box((1, 1, 1)), RED), Part(light, RED, tf.translation(0, 0, k))))
        edit.set_pose(("lamp", k), (k, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5))
    before, after = flatten(edit.commit()).lights, reread(edit.root).lights
    assert len(before) == len(after) == 3
    for old, new in zip(before, after, strict=True):
        assert replace(new, position=old.position, direction=old.direction) == old
        np.testing.assert_allclose((new.position, new.direction), (old.position, old.direction), atol=1e-12)


def test_trimesh_reads_the_same_triangles_in_y_up() -> None:
    root = scene()
    loaded = trimesh.load_scene(io.BytesIO(export_glb(root)), file_type="glb", process=False)
    corners = []
    for frame in loaded.graph.nodes_geometry:
        X, name = loaded.graph[frame]
        geometry = loaded.geometry[name]
        if isinstance(geometry, trimesh.Trimesh):
            world = geometry.vertices @ X[:3, :3].T + X[:3, 3]
            corners.append(world[geometry.faces].reshape(-1, 3))
    ours = soup(flatten(Node(None, tf.Y_UP_TO_Z_UP.T, {"tree": root})))[Topology.TRIANGLES]
    found = np.concatenate(corners)
    assert len(found) == len(ours)
    np.testing.assert_allclose(sorted_rows(found), sorted_rows(ours), atol=1e-4)


def test_nodes_keep_names_and_parents() -> None:
    nodes = document(export_glb(scene()))["nodes"]
    by_name = {node["name"]: node for node in nodes if "name" in node}
    children = {nodes[index].get("name") for index in by_name["robot"]["children"]}
    assert {"arm/1", "7"} <= children
    np.testing.assert_array_equal(np.reshape(nodes[0]["matrix"], (4, 4)).T @ (0, 0, 1, 1), (0, 1, 0, 1))


def test_equal_meshes_materials_and_images_are_written_once() -> None:
    image = image_from_bytes(png_rgba(np.full((2, 2, 4), 9, np.uint8)))
    first = Material(base_color_texture=Texture(image))
    second = Material(base_color_texture=Texture(image, Sampler(wrap_s=Wrap.MIRRORED_REPEAT)), metallic=0.0)
    edit = TreeEdit(Node())
    for index in range(50):
        edit.set_parts((index,), (Part(Box((1, 1, 1 + index)), first if index % 2 else second),))
    written = document(export_glb(edit.commit()))
    assert len(written["meshes"]) == 2
    assert len(written["accessors"]) == 3
    assert len(written["images"]) == 1
    assert len(written["textures"]) == 2


UV = np.array([(0, 0), (1, 0), (0, 1)], np.float32)
TRIANGLE = Mesh(np.eye(3, dtype=np.float32), np.array([(0, 1, 2)], np.uint32), uv0=UV, uv1=UV)


def one(shape: Any, material: Material = RED) -> Node:
    return Node((Part(shape, material),))


def textured(image: Image) -> Node:
    return one(Surface(TRIANGLE), Material(base_color_texture=Texture(image)))


def test_materials_round_trip() -> None:
    image = image_from_bytes(png_rgba(np.full((2, 3, 4), 77, np.uint8)))
    angle = 0.3
    transform = (2 * math.cos(angle), 3 * math.sin(angle), 0.1, -2 * math.sin(angle), 3 * math.cos(angle), 0.2)
    sampler = Sampler(Wrap.CLAMP_TO_EDGE, Wrap.MIRRORED_REPEAT, mag_linear=False, min_linear=False, mipmaps=False)
    material = Material(
        base_color=(0.1, 0.2, 0.3, 0.4),
        base_color_texture=Texture(image, sampler, 1, transform),
        metallic=0.25,
        roughness=0.75,
        metallic_roughness_texture=Texture(image),
        normal_texture=Texture(image),
        normal_scale=0.5,
        occlusion_texture=Texture(image),
        occlusion_strength=0.25,
        emissive=(0.5, 0.25, 0.125),
        emissive_texture=Texture(image),
        alpha_mode=AlphaMode.MASK,
        alpha_cutoff=0.75,
        double_sided=True,
        unlit=True,
    )
    (instance,) = reread(one(Surface(TRIANGLE), material)).instances
    found = instance.material
    assert found.base_color == pytest.approx(material.base_color)
    assert found.base_color_texture.sampler == sampler
    assert found.base_color_texture.uv_set == 1
    assert found.base_color_texture.uv_transform == pytest.approx(transform)
    for name in ("metallic", "roughness", "normal_scale", "occlusion_strength", "alpha_mode", "alpha_cutoff"):
        assert getattr(found, name) == getattr(material, name), name
    assert (found.emissive, found.double_sided, found.unlit) == (material.emissive, True, True)
    for name in ("metallic_roughness_texture", "normal_texture", "occlusion_texture", "emissive_texture"):
        texture = getattr(found, name)
        np.testing.assert_array_equal(texture.image.decode(), np.full((2, 3, 4), 77))
    np.testing.assert_array_equal(instance.mesh.uv1, UV)


def test_colors_of_clouds_are_written_linear_and_those_of_meshes_as_they_are() -> None:
    shown = np.array(((0.2, 0.4, 0.6, 0.5), (1.0, 0.0, 0.04, 1.0)), dtype=np.float32)
    [points] = reread(one(PointCloud(np.zeros((2, 3), np.float32), {"rgb": shown}))).instances
    # IEC 61966-2-1 by hand; alpha is no light.
    expected = ((0.0331048, 0.1328683, 0.3185468, 0.5), (1.0, 0.0, 0.0030960, 1.0))
    np.testing.assert_allclose(points.mesh.colors, expected, atol=1e-6)

    positions = np.array(((0, 0, 0), (1, 0, 0)), dtype=np.float32)
    mesh = Mesh(positions, np.array(((0, 1),), dtype=np.uint32), colors=shown)
    [lines] = reread(one(Surface(mesh))).instances
    np.testing.assert_array_equal(lines.mesh.colors, shown)


def test_pixels_without_a_file_become_a_png() -> None:
    pixels = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    (instance,) = reread(textured(Image(b"raw", lambda: pixels))).instances
    np.testing.assert_array_equal(instance.material.base_color_texture.image.decode(), pixels)


def test_an_image_that_cannot_be_decoded_is_left_out() -> None:
    def broken() -> np.ndarray:
        raise ImageError("broken")

    (instance,) = reread(textured(Image(b"bad", broken))).instances
    assert instance.material.base_color_texture is None


def test_hidden_and_non_finite_nodes_are_left_out() -> None:
    edit = TreeEdit(Node())
    edit.set_parts(("seen",), (Part(Box((1, 1, 1)), RED),))
    edit.set_parts(("hidden",), (Part(Box((1, 1, 1)), RED),))
    edit.set_visible(("hidden",), False)
    edit.set_parts(("lost", "child"), (Part(Box((1, 1, 1)), RED),))
    edit.set_pose(("lost",), (math.nan, 0, 0, 1, 0, 0, 0))
    edit.set_parts(("part",), (Part(Box((1, 1, 1)), RED, np.full((4, 4), math.inf)),))
    names = [node.get("name") for node in document(export_glb(edit.commit()))["nodes"]]
    assert "seen" in names
    assert not {"hidden", "lost", "child"} & set(names)
    assert len(reread(edit.root).instances) == 1


def test_opacity_of_nodes_is_in_the_materials() -> None:
    edit = TreeEdit(Node())
    edit.set_parts(("group", "box"), (Part(Box((1, 1, 1)), RED),))
    edit.set_opacity(("group",), 0.5)
    edit.set_opacity(("group", "box"), 0.5)
    (instance,) = reread(edit.commit()).instances
    assert instance.material.base_color == pytest.approx((*RED.base_color[:3], 0.25 * RED.base_color[3]))
    assert instance.material.alpha_mode is AlphaMode.BLEND


def test_an_empty_tree_is_a_valid_file() -> None:
    read = read_gltf(export_glb(Node()))
    assert read.instance_count == 0
    assert "buffers" not in document(export_glb(Node()))


poses = st.tuples(*[st.floats(-9, 9)] * 3, st.just(1.0), *[st.floats(-1, 1)] * 3)


@given(st.lists(st.tuples(st.lists(st.sampled_from(["a", "b", 1]), max_size=3).map(tuple), poses), max_size=6))
@settings(deadline=None, max_examples=40)
def test_bounds_round_trip(moves: Any) -> None:
    edit = TreeEdit(Node())
    for path, pose in moves:
        edit.set_pose(path, pose)
        edit.set_parts(path, (Part(Capsule(0.2, 1), RED, tf.translation(1, 0, 0)),))
    root = edit.commit()
    before, after = scene_bounds(flatten(root)), scene_bounds(reread(root))
    if before is None:
        assert after is None
    else:
        np.testing.assert_allclose(after, before, atol=1e-3)


@pytest.mark.corpus
def test_recorded_scenes_round_trip() -> None:
    """Scenes of Drake's own client: textures, vertex colours, negative scales and shared meshes, as it sends them."""
    checked = 0
    for file in sorted(corpus_dir().glob("drake/scenes/*/color/scene.gltf")):
        data = file.read_bytes()
        if len(data) > 1 << 20:
            continue
        root = read_gltf(data).root
        before, after = soup(flatten(root)), soup(reread(root))
        assert before.keys() == after.keys(), file
        for topology in before:
            np.testing.assert_allclose(sorted_rows(after[topology]), sorted_rows(before[topology]), atol=1e-4)
        checked += 1
    assert checked >= 3


def test_camera_round_trip() -> None:
    pose = tf.look_at((2.0, -3.0, 1.5), (0.0, 0.5, 0.2), (0.0, 0.0, 1.0))
    camera = Camera(64, 48, 50.0, 40.0, 32.0, 24.0, 0.125, 16.0, pose)
    read = read_gltf(export_glb(scene(), camera=camera))
    np.testing.assert_allclose(tf.Y_UP_TO_Z_UP @ read.camera.X_world_camera, pose, atol=1e-12)
    written = document(export_glb(scene(), camera=camera))["cameras"]
    assert written[0]["type"] == "perspective"
    lens = written[0]["perspective"]
    assert (lens["znear"], lens["zfar"]) == (0.125, 16.0)
    assert np.tan(lens["yfov"] / 2) == pytest.approx(24.0 / 40.0)
    assert lens["aspectRatio"] * np.tan(lens["yfov"] / 2) == pytest.approx(32.0 / 50.0)
    endless = replace(camera, far=float("inf"))
    assert "zfar" not in document(export_glb(scene(), camera=endless))["cameras"][0]["perspective"]


@pytest.mark.parametrize("mag_linear", [False, True])
@pytest.mark.parametrize(("min_linear", "mipmaps"), [(True, True), (True, False), (False, True), (False, False)])
def test_samplers_round_trip(mag_linear: bool, min_linear: bool, mipmaps: bool) -> None:
    sampler = Sampler(
        Wrap.MIRRORED_REPEAT, Wrap.CLAMP_TO_EDGE, mag_linear=mag_linear, min_linear=min_linear, mipmaps=mipmaps
    )
    image = image_from_bytes(png_rgba(np.full((2, 2, 4), 200, np.uint8)))
    material = Material(base_color_texture=Texture(image, sampler, name="paint"))
    glb = export_glb(one(Surface(TRIANGLE), material))
    (written,) = document(glb)["samplers"]
    assert written["magFilter"] == (9729 if mag_linear else 9728)
    filters = {(True, True): 9987, (True, False): 9729, (False, True): 9984, (False, False): 9728}
    assert written["minFilter"] == filters[min_linear, mipmaps]
    (drawn,) = flatten(read_gltf(glb).root).instances
    texture = drawn.material.base_color_texture
    assert texture.name == "images[0] (paint)"
    assert texture.sampler == replace(sampler, mip_linear=texture.sampler.mip_linear)


@pytest.mark.parametrize(("count", "component"), [(65_534, 5123), (65_535, 5125), (65_536, 5125)])
def test_indices_are_16_bit_while_the_restart_value_is_no_vertex(count: int, component: int) -> None:
    positions = np.zeros((count, 3), np.float32)
    positions[-1] = (1, -1e13, 3)
    mesh = Mesh(positions, np.array([[count - 1, 0, 1]], np.uint32))
    glb = export_glb(one(Surface(mesh)))
    accessors = document(glb)["accessors"]
    assert [each["componentType"] for each in accessors] == [5126, component]
    assert accessors[0]["min"] == [0, np.float32(-1e13), 0]
    assert accessors[0]["max"] == [1, 0, 3]
    assert "min" not in accessors[1]
    (read,) = flatten(read_gltf(glb).root).instances
    assert read.mesh.positions[read.mesh.elements[0, 0]].tolist() == positions[-1].tolist()


@pytest.mark.parametrize(("value", "written"), [(-0.5, 0), (0.25, 0.25), (1.5, 1), (math.nan, 1), (math.inf, 1)])
def test_factors_are_clamped_to_the_range_of_gltf(value: float, written: float) -> None:
    material = Material(base_color=(0.5, value, 1, 1), metallic=value, roughness=value, emissive=(0, value, 1))
    (entry,) = document(export_glb(one(Box((1, 1, 1)), material)))["materials"]
    pbr = entry["pbrMetallicRoughness"]
    assert pbr["baseColorFactor"] == [0.5, written, 1, 1]
    assert (pbr["metallicFactor"], pbr["roughnessFactor"]) == (written, written)
    assert entry["emissiveFactor"] == [0, written, 1]


def test_a_file_of_exactly_the_limit_is_written() -> None:
    root = one(Box((1, 1, 1)))
    size = document(export_glb(root))["buffers"][0]["byteLength"]
    assert export_glb(root, max_bytes=size)
    with pytest.raises(FileTooLargeError, match=f"larger than {size - 1} bytes"):
        export_glb(root, max_bytes=size - 1)


@pytest.mark.parametrize(
    ("x", "written"), [(9e14, True), (-9e14, True), (1e15, False), (-1e15, False), (math.nan, False)]
)
def test_nodes_with_huge_transforms_are_left_out(x: float, written: bool) -> None:
    matrix = np.eye(4)
    matrix[1, 3] = x
    root = Node(None, tf.IDENTITY, {"far": Node((Part(Box((1, 1, 1)), RED),), matrix)})
    assert len(document(export_glb(root)).get("meshes", ())) == written


def test_views_of_the_buffer_are_aligned_to_four_bytes() -> None:
    mesh = Mesh(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]], np.uint32))
    other = Mesh(2 * np.eye(3, dtype=np.float32), np.array([[2, 1, 0]], np.uint32))
    written = document(export_glb(Node((Part(Surface(mesh), RED), Part(Surface(other), RED)))))
    views = written["bufferViews"]
    assert [view["byteLength"] for view in views] == [36, 6, 36, 6]
    assert [view["byteOffset"] for view in views] == [0, 36, 44, 80]
    assert [view["target"] for view in views] == [34962, 34963] * 2
    assert written["buffers"][0]["byteLength"] == 88
