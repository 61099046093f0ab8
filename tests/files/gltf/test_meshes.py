from typing import Any

import numpy as np
import pytest

from gateway.files.gltf import GltfCache
from gateway.files.gltf.gltf_errors import GltfError
from gateway.files.gltf.topology import element_count, separate_elements
from renderers.cache import CacheBudget
from renderers.drawlist import Topology
from tests.files.gltf.builder import TRIANGLE, Builder, corners, data_uri, drawn, meshes, only_mesh
from tests.files.gltf.test_material_reader import png

SQUARE = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], np.float32)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        (0, [[4], [3], [2], [1], [0]]),
        (1, [[4, 3], [2, 1]]),
        (2, [[4, 3], [3, 2], [2, 1], [1, 0], [0, 4]]),
        (3, [[4, 3], [3, 2], [2, 1], [1, 0]]),
        (4, [[4, 3, 2]]),
        (5, [[4, 3, 2], [3, 1, 2], [2, 1, 0]]),
        (6, [[3, 2, 4], [2, 1, 4], [1, 0, 4]]),
    ],
)
def test_modes(mode: int, expected: list[list[int]]) -> None:
    elements = separate_elements(mode, np.array([4, 3, 2, 1, 0], np.uint16))
    assert elements.tolist() == expected
    assert elements.dtype == np.uint32
    assert elements.flags.c_contiguous


@pytest.mark.parametrize("mode", range(7))
@pytest.mark.parametrize("length", range(9))
def test_element_count_agrees_with_the_elements(mode: int, length: int) -> None:
    assert len(separate_elements(mode, np.arange(length, dtype=np.uint32))) == element_count(mode, length)


@pytest.mark.parametrize("mode", [2, 3, 5, 6])
def test_primitive_restart_begins_another_strip(mode: int) -> None:
    """As cesium-native, which splits the index lists of vector tiles. Each part has the winding of a strip."""
    rng = np.random.default_rng(mode)
    for _ in range(200):
        strips = [rng.integers(0, 99, rng.integers(0, 7)).astype(np.uint8) for _ in range(rng.integers(1, 5))]
        joined = np.concatenate([np.append(strip, 255) for strip in strips])[: -1 if rng.integers(2) else None]
        expected = np.concatenate([separate_elements(mode, strip) for strip in strips])
        assert separate_elements(mode, joined.astype(np.uint8), 255).tolist() == expected.tolist()


@pytest.mark.parametrize(("mode", "count"), [(2, 7), (3, 5), (5, 3), (6, 3)])
def test_the_largest_index_of_a_type_restarts_strips(mode: int, count: int) -> None:
    positions = np.random.default_rng(0).random((300, 3))
    mesh = drawn(positions, [255, 0, 1, 2, 255, 255, 3, 4, 5, 6], mode=mode)
    assert len(mesh.elements) == count
    assert mesh.elements.max() == 6


@pytest.mark.parametrize("mode", [2, 3, 5, 6])
@pytest.mark.parametrize("order", [[255] * 8, [255, 0] * 8])
def test_nothing_but_restarts_draws_nothing(mode: int, order: list[int]) -> None:
    scene = Builder().draw(SQUARE, order, mode=mode).read()
    assert (meshes(scene), scene.warnings) == ([], ())


@pytest.mark.parametrize(("typecode", "largest"), [("B", 255), ("H", 65535)])
def test_the_largest_index_of_a_type_is_a_vertex_in_lists(typecode: str, largest: int) -> None:
    """As in WebGPU; exporters write 16-bit indices for meshes of exactly 65536 vertices."""
    b = Builder()
    b.draw(np.random.default_rng(0).random((largest + 1, 3)))
    b.json["meshes"][0]["primitives"][0]["indices"] = b.accessor([0, 1, largest], typecode)
    assert len(only_mesh(b.read()).elements) == 1


@pytest.mark.parametrize(("mode", "order"), [(4, [0, 1, 2, 2, 1, 3]), (5, [0, 1, 2, 3]), (6, [0, 1, 3, 2])])
def test_strips_and_fans_cover_the_square_with_one_winding(mode: int, order: list[int]) -> None:
    for mesh in (drawn(SQUARE, order, mode=mode), drawn(SQUARE[order], mode=mode)):
        c = corners(mesh)
        areas = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])[:, 2] / 2
        assert areas.tolist() == [0.5, 0.5]


@pytest.mark.parametrize("mode", range(4))
def test_lines_and_points_have_no_normals_of_their_own(mode: int) -> None:
    mesh = drawn(SQUARE, mode=mode)
    assert mesh.topology == (Topology.LINES if mode else Topology.POINTS)
    assert mesh.normals is None


@pytest.mark.parametrize("attributes", [{"TANGENT": [(1, 0, 0, 1)] * 4}, {"NORMAL": np.zeros((4, 3))}])
def test_triangles_without_normals_are_flat_and_their_tangents_are_ignored(attributes: Any) -> None:
    """glTF 2.0, 3.7.2.1: no vertex is duplicated for it, the renderer computes the normals of faces.

    Normals of which none has a direction count as missing.
    """
    mesh = drawn(SQUARE, mode=5, **attributes)
    assert mesh.normals is None
    assert mesh.tangents is None
    assert len(mesh.positions) == 4


@pytest.mark.parametrize(
    ("generator", "material", "smooth"),
    [
        ("VTK", {}, True),
        ("Drake glTF merger", {}, True),
        ("Drake glTF merger", {"name": "of a glTF file"}, False),
        ("Blender", {}, False),
    ],
)
def test_shapes_of_drake_whose_normals_vtk_omits_are_smooth(generator: str, material: Any, smooth: bool) -> None:
    """A roof of 120 degrees, whose triangles share the vertices of the ridge."""
    b = Builder(generator)
    pbr = {"baseColorFactor": [1, 0, 0, 1], "metallicFactor": 0.0, "roughnessFactor": 1.0}
    b.json["materials"] = [{"pbrMetallicRoughness": pbr, **material}]
    roof = [(0, 0, 0), (0, 1, 0), (-1, 0, 0), (0.5, 0, -(0.75**0.5))]
    mesh = only_mesh(b.draw(roof, [0, 1, 2, 0, 3, 1], material=0).read())
    assert (mesh.normals is not None) == smooth
    if mesh.normals is not None:
        assert len(mesh.positions) == 4
        np.testing.assert_allclose(mesh.normals[:2], [(0.5, 0, 0.75**0.5)] * 2, atol=1e-6)


def test_a_vertex_whose_normal_has_no_direction_gets_that_of_one_of_its_triangles_with_an_area() -> None:
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (2, 0, 0), (5, 5, 5)]
    normals = [(0, 0, 0), (0, 1, 0), (0, 1, 0), (np.inf, 0, 0), (0, 0, 0)]
    mesh = drawn(corners, [0, 1, 2, 0, 1, 3], NORMAL=normals)
    assert mesh.normals.tolist() == [[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1]]


def test_given_normals_get_unit_length_and_bad_ones_are_computed() -> None:
    mesh = drawn(TRIANGLE[[0, 2, 1]], NORMAL=[(0, 0, 5), (0, 0, 0), (np.nan, 0, 0)])
    assert mesh.normals.tolist() == [[0, 0, 1], [0, 0, -1], [0, 0, -1]]


def test_quantised_normals_get_unit_length() -> None:
    b = Builder()
    mesh = only_mesh(b.draw(NORMAL=b.accessor([(64, 64, 0)] * 3, "b", normalized=True)).read())
    np.testing.assert_allclose(mesh.normals, np.full((3, 3), (0.5**0.5, 0.5**0.5, 0)), atol=1e-6)


def test_triangles_with_non_finite_vertices_are_dropped() -> None:
    positions = np.vstack([SQUARE, (np.nan, 0, 0), (0, np.inf, 0)])
    scene = Builder().draw(positions, [0, 1, 2, 0, 1, 4, 5, 1, 2, 2, 1, 3]).read()
    mesh = only_mesh(scene)
    assert mesh.elements.tolist() == [[0, 1, 2], [2, 1, 3]]
    assert np.isfinite(mesh.positions).all()
    assert scene.warnings == ("meshes[0].primitives[0]: 2 elements with vertices that are not finite are left out",)


@pytest.mark.parametrize(
    ("dtype", "values", "expected"),
    [
        ("f", [(1, 0.5, 0)] * 3, (1, 0.5, 0, 1)),
        ("B", [(255, 51, 0)] * 3, (1, 0.2, 0, 1)),
        ("H", [(65535, 13107, 0, 13107)] * 3, (1, 0.2, 0, 0.2)),
        ("f", [(7, -1, np.nan, 0.25)] * 3, (1, 0, 0, 0.25)),
    ],
)
def test_vertex_colours_become_rgba(dtype: str, values: Any, expected: tuple[float, ...]) -> None:
    b = Builder()
    mesh = only_mesh(b.draw(COLOR_0=b.accessor(values, dtype, normalized=dtype != "f")).read())
    np.testing.assert_allclose(mesh.colors, np.full((3, 4), expected), atol=1e-6)


def test_second_texture_coordinates_and_tangents() -> None:
    uv = TRIANGLE[:, :2]
    tangents = [(3, 0, 0, -1), (0, 0, 0, 1), (0, 1, 0, 0.9)]
    mesh = drawn(NORMAL=[(0, 0, 1)] * 3, TEXCOORD_0=uv, TEXCOORD_1=2 * uv, TANGENT=tangents)
    assert (mesh.uv1 == 2 * uv).all()
    assert mesh.tangents.tolist() == [[1, 0, 0, -1], [1, 0, 0, 1], [0, 1, 0, 1]]


@pytest.mark.parametrize("colors", [1, 2, 12])
def test_unusable_attributes_are_left_out_with_a_warning(colors: int) -> None:
    """VTK's exporter writes a colour for each triangle."""
    scene = Builder().draw(TEXCOORD_0=TRIANGLE, COLOR_0=np.eye(3, 4)[[0] * colors], _CUSTOM=99).read()
    mesh = only_mesh(scene)
    assert mesh.uv0 is None
    assert mesh.colors is None
    assert [w.split(":")[0].rpartition(".")[2] for w in scene.warnings] == ["TEXCOORD_0", "COLOR_0"]
    assert f"{colors} values" in scene.warnings[1]


@pytest.mark.parametrize(
    ("first", "second", "warns"),
    [(1, 0.5, True), (1, 1, False), (0.5, 0.25, False), (None, 0.5, True), (None, 1, False)],
)
def test_colors_that_are_not_drawn_have_a_warning(first: float | None, second: float, warns: bool) -> None:
    factors = {"COLOR_0": first, "COLOR_1": second}
    attributes = {name: np.full((3, 4), factor) for name, factor in factors.items() if factor is not None}
    assert any("COLOR_1" in warning for warning in Builder().draw(**attributes).read().warnings) is warns


@pytest.mark.parametrize(("uv_set", "stored", "missing"), [(0, "0", ""), (0, "1", "0"), (1, "0", "1"), (1, "01", "")])
def test_a_texture_without_its_coordinates_has_a_warning(uv_set: int, stored: str, missing: str) -> None:
    b = Builder()
    b.add("images", {"uri": data_uri(png(), "image/png")})
    b.add("textures", {"source": 0})
    b.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "texCoord": uv_set}}})
    warnings = b.draw(material=0, **{f"TEXCOORD_{number}": TRIANGLE[:, :2] for number in stored}).read().warnings
    assert len(warnings) == bool(missing)
    assert all(f"TEXCOORD_{missing}" in warning for warning in warnings)


def test_primitives_without_elements_are_left_out() -> None:
    b = Builder()
    primitives: tuple[dict[str, Any], ...] = (
        {},
        {"attributes": None},
        {"attributes": {"NORMAL": b.accessor(TRIANGLE)}},
        {"attributes": {"POSITION": b.accessor(TRIANGLE[:2])}},
        {"attributes": {"POSITION": b.accessor(TRIANGLE[:0])}},
    )
    b.node(mesh=b.mesh(*primitives))
    scene = b.read()
    assert scene.instance_count == 0
    assert scene.root.children["node0"].parts == ()


def test_primitives_that_share_one_vertex_buffer_keep_their_range() -> None:
    b = Builder()
    p = b.accessor(np.arange(300, dtype=np.float32).reshape(100, 3) ** 1.5)
    narrow, wide = meshes(b.draw(p, [10, 12, 11]).draw(p, [0, 99, 50]).read())
    assert len(narrow.positions) == 3
    assert len(wide.positions) == 100
    assert (corners(narrow)[0] == wide.positions[[10, 12, 11]]).all()


def chairs(count: int) -> Builder:
    """Return a document with N copies of one mesh, as Drake sends N instances."""
    b = Builder()
    positions = np.random.default_rng(1).random((30, 3))
    for _ in range(count):
        b.draw(positions, np.arange(30))
    return b


def test_copies_are_one_mesh_also_with_a_full_cache() -> None:
    full = GltfCache(CacheBudget(100))
    for scene in (chairs(5).read(), chairs(5).read(cache=full)):
        assert len(meshes(scene)) == 5
        assert len({id(mesh) for mesh in meshes(scene)}) == 1
    assert full.content.nbytes <= 100


def test_another_layout_of_the_same_bytes_is_another_mesh() -> None:
    b = Builder()
    view = b.view(np.arange(12, dtype=np.float32).tobytes())
    for more in ({}, {"byteOffset": 12}, {}):
        b.draw(b.add("accessors", {"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3", **more}))
    x, y, z = meshes(b.read())
    assert x is z
    assert x is not y


def test_a_small_file_with_many_instances_is_refused_by_default() -> None:
    """90 million triangles of 5 MB took 20 GB of memory to draw."""
    b = Builder()
    corners = b.accessor(np.zeros((3, 3), np.float32))
    indices = b.accessor(np.zeros(3 * 10_000, np.uint32), "I")
    mesh = b.mesh({"attributes": {"POSITION": corners}, "indices": indices})
    for _ in range(1_001):
        b.node(mesh=mesh)
    with pytest.raises(GltfError, match="max_drawn_elements = 10000000"):
        b.read()


@pytest.mark.parametrize(("count", "expected"), [(7, 7), (8, 4)])
def test_a_range_of_at_most_half_of_the_vertices_is_cut_out(count: int, expected: int) -> None:
    """The primitive uses the vertices 2 to 5 of ``count``."""
    positions = np.random.default_rng(count).random((count, 3), np.float32)
    mesh = drawn(positions, [2, 3, 5, 4, 2, 3], TEXCOORD_0=positions[:, :2])
    assert len(mesh.positions) == expected
    assert len(mesh.uv0) == expected
    np.testing.assert_array_equal(corners(mesh), positions[[[2, 3, 5], [4, 2, 3]]])
    np.testing.assert_array_equal(mesh.uv0[mesh.elements], positions[[[2, 3, 5], [4, 2, 3]], :2])


@pytest.mark.parametrize("vertex", [0, 99_999])
@pytest.mark.parametrize("axis", range(3))
def test_the_first_and_the_last_vertex_of_a_large_mesh_are_kept(vertex: int, axis: int) -> None:
    positions = np.zeros((100_000, 3), np.float32)
    positions[vertex, axis] = -1e13
    mesh = drawn(positions, np.arange(99_999, -1, -1), mode=0)
    assert mesh.positions.min(axis=0).tolist() == np.where(np.arange(3) == axis, np.float32(-1e13), 0).tolist()
    assert mesh.positions[vertex, axis] == np.float32(-1e13)


@pytest.mark.parametrize("attribute", ["NORMAL", "TANGENT", "TEXCOORD_0", "TEXCOORD_1"])
def test_attributes_may_have_more_values_than_vertices_but_not_fewer(attribute: str) -> None:
    width = {"NORMAL": 3, "TANGENT": 4, "TEXCOORD_0": 2, "TEXCOORD_1": 2}[attribute]
    for count in (2, 3, 4):
        values = {attribute: np.full((count, width), width**-0.5)}
        values.setdefault("NORMAL", np.array([(0, 0, 1)] * 3))
        scene = Builder().draw(**values).read()
        path = f"meshes[0].primitives[0].attributes.{attribute}"
        expected = f"{path}: accessors[1] has 2 values for 3 vertices; {path} is ignored"
        assert scene.warnings == ((expected,) if count == 2 else ())
        mesh = only_mesh(scene)
        arrays = (mesh.normals, mesh.tangents, mesh.uv0, mesh.uv1, mesh.colors)
        for name, array in zip(("NORMAL", "TANGENT", "TEXCOORD_0", "TEXCOORD_1", "COLOR_0"), arrays, strict=True):
            expected_present = (name == "NORMAL" and attribute != name) or (name == attribute and count > 2)
            assert (array is not None) == expected_present
            assert array is None or len(array) == 3


def test_texture_coordinates_that_are_not_finite_are_0_with_a_warning() -> None:
    scene = Builder().draw(TEXCOORD_0=[(np.nan, 1), (2, -np.inf), (np.inf, -1e13)]).read()
    assert only_mesh(scene).uv0.tolist() == [[0, 1], [2, 0], [0, np.float32(-1e13)]]
    assert scene.warnings == ("meshes[0].primitives[0].TEXCOORD_0: numbers that are not finite are read as 0",)


@pytest.mark.parametrize(("length", "kept"), [(1.0009, True), (0.9991, True), (1.002, False), (0.998, False)])
@pytest.mark.parametrize("axis", range(3))
def test_normals_within_a_thousandth_of_unit_length_are_kept(length: float, kept: bool, axis: int) -> None:
    normal = np.zeros(3, np.float32)
    normal[axis] = -length
    mesh = drawn(NORMAL=[normal] * 3)
    assert mesh.normals[0, axis] == (normal[axis] if kept else -1.0)


@pytest.mark.parametrize("bad", [(0, 0, 0), (np.nan, 1, 0), (0, np.inf, 0)])
def test_normals_of_lines_without_a_direction_point_along_z(bad: tuple[float, ...]) -> None:
    mesh = drawn(NORMAL=[(0, -2, 0), bad, (1, 0, 0)], mode=3)
    assert mesh.normals.tolist() == [[0, -1, 0], [0, 0, 1], [1, 0, 0]]


def test_the_size_of_the_meshes_counts_each_once() -> None:
    b = Builder()
    shared = b.mesh({"attributes": {"POSITION": b.accessor(TRIANGLE)}}, {"attributes": {"POSITION": 0}})
    b.node(mesh=shared)
    b.node(mesh=shared)
    cache = GltfCache()
    for _ in range(2):  # new, and from the cache
        scene = b.read(cache=cache)
        assert scene.content.mesh_bytes == meshes(scene)[0].nbytes == 3 * 12 + 12
        assert scene.content.element_counts == {0: 2}
    assert scene.element_count == 4
