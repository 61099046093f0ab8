import gc
import math
import weakref
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.scene.draw.meshing import MAX_CAPSULE_ASPECT, MAX_EXTENT, MIN_EXTENT, meshes_of
from gateway.scene.tree.geometry import Line, PointCloud, Shape, Surface
from renderers import primitives
from renderers.color import linear_from_srgb
from renderers.drawlist import Material, Mesh, Topology
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Solid, Sphere, Triad
from tests.support.solids import TYPES, solids

MATERIAL = Material(base_color=(0.2, 0.4, 0.6, 0.5))


def placed(shape: Shape) -> list[trimesh.Trimesh]:
    """The triangle meshes of a shape in its own frame, equal positions merged."""
    out = []
    for mesh, _, matrix in meshes_of(shape, MATERIAL):
        if mesh.topology is Topology.TRIANGLES:
            solid = trimesh.Trimesh(mesh.positions, mesh.elements, process=False)
            solid.apply_transform(matrix)
            solid.merge_vertices(merge_norm=True, merge_tex=True)
            out.append(solid)
    return out


def bounds(shape: Shape) -> np.ndarray:
    corners = [
        (mesh.positions.astype(float) @ matrix[:3, :3].T + matrix[:3, 3])
        for mesh, _, matrix in meshes_of(shape, MATERIAL)
    ]
    points = np.concatenate(corners)
    return np.array((points.min(axis=0), points.max(axis=0)))


def ellipsoid_area(a: float, b: float, c: float) -> float:
    """Thomsen's formula, within 1.1 %."""
    p = 1.6075
    return float(4.0 * math.pi * (((a * b) ** p + (a * c) ** p + (b * c) ** p) / 3) ** (1 / p))


SOLIDS: list[tuple[Solid, float, float, tuple[float, float, float]]] = [
    # shape, volume, area, half of its extents
    (Box((1, 2, 3)), 6.0, 22.0, (0.5, 1, 1.5)),
    (Sphere(0.7), 4 / 3 * math.pi * 0.7**3, 4 * math.pi * 0.49, (0.7, 0.7, 0.7)),
    (Ellipsoid((1, 2, 0.5)), 4 / 3 * math.pi, ellipsoid_area(1, 2, 0.5), (1, 2, 0.5)),
    (Cylinder(0.5, 3), math.pi * 0.75, math.pi * 3 + math.pi * 0.5, (0.5, 0.5, 1.5)),
    (Capsule(0.5, 3), math.pi * 0.75 + 4 / 3 * math.pi * 0.125, math.pi * 3 + math.pi, (0.5, 0.5, 2.0)),
    (Capsule(0.5, 0), 4 / 3 * math.pi * 0.125, math.pi, (0.5, 0.5, 0.5)),
]


def test_every_solid_type_is_compared_with_its_formulae() -> None:
    compared = {type(shape) for shape, *_ in SOLIDS}
    assert compared == set(TYPES) - {Triad}, "a triad is lines"


@pytest.mark.parametrize(("shape", "volume", "area", "half"), SOLIDS, ids=lambda value: type(value).__name__)
def test_solids_are_closed_and_match_the_formulae(shape: Any, volume: Any, area: Any, half: Any) -> None:
    (solid,) = placed(shape)
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.volume == pytest.approx(volume, rel=0.01)
    assert solid.volume <= volume * (1 + 1e-6)
    assert solid.area == pytest.approx(area, rel=0.015)
    np.testing.assert_allclose(bounds(shape), (-np.array(half), half), atol=1e-6)


@pytest.mark.parametrize(
    "mesh", [*(meshes_of(shape, MATERIAL)[0][0] for shape, *_ in SOLIDS), primitives.cone(), primitives.capsule(1e-3)]
)
def test_unit_meshes_have_unit_outward_normals_that_agree_with_the_winding(mesh: Mesh) -> None:
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)
    corners = mesh.positions[mesh.elements].astype(float)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    assert np.einsum("fc,fkc->fk", faces, mesh.normals[mesh.elements].astype(float)).min() > 0.97
    assert trimesh.Trimesh(mesh.positions, mesh.elements, process=False).volume > 0.0, "normals point inwards"


def test_unit_meshes_are_shared_and_cannot_be_written_to() -> None:
    (first,), (second,) = meshes_of(Box((1, 2, 3)), MATERIAL), meshes_of(Box((4, 5, 6)), MATERIAL)
    assert first[0] is second[0]
    assert first[1] is MATERIAL
    with pytest.raises(ValueError, match="read-only"):
        first[0].positions[0] = 0.0


@pytest.mark.parametrize(
    "shape",
    [
        Box((0, 0, 0)),
        Box((1, math.nan, 1)),
        Box((1, math.inf, 1)),
        Sphere(0),
        Sphere(-1),
        Sphere(math.nan),
        Ellipsoid((0, 0, 0)),
        Cylinder(1, 0),
        Cylinder(math.nan, 1),
        Cylinder(0, math.inf),
        Capsule(0, 0),
        Capsule(1, math.nan),
        Triad(0),
        Triad(math.nan),
        PointCloud(np.zeros((0, 3), np.float32)),
        PointCloud(np.full((3, 3), np.nan, np.float32)),
        Line(np.zeros((0, 3), np.float32)),
        Line(np.zeros((1, 3), np.float32), end_head=True),
        Line(np.ones((5, 3), np.float32), end_head=True, closed=True),
        Line(np.full((5, 3), np.inf, np.float32)),
    ],
    ids=repr,
)
def test_shapes_without_extent_draw_nothing(shape: Any) -> None:
    assert meshes_of(shape, MATERIAL) == ()


@pytest.mark.parametrize("shape", [Cylinder(0, 2), Cylinder(-1, 2), Capsule(0, 2), Capsule(0, -2)])
def test_without_radius_a_cylinder_is_a_line(shape: Any) -> None:
    ((mesh, _, _),) = meshes_of(shape, MATERIAL)
    assert mesh.topology is Topology.LINES
    np.testing.assert_array_equal(bounds(shape), ((0, 0, -1), (0, 0, 1)))


def test_negative_lengths_count_as_positive_and_flat_boxes_keep_an_invertible_transform() -> None:
    ((_, _, mirrored),) = meshes_of(Box((-1, 2, -3)), MATERIAL)
    np.testing.assert_array_equal(mirrored, np.diag((1, 2, 3, 1)))
    ((_, _, flat),) = meshes_of(Box((2, 3, 0)), MATERIAL)
    assert abs(np.linalg.det(flat)) > 0
    assert bounds(Box((2, 3, 0)))[1, 2] < 1e-5


def test_a_surface_is_drawn_as_it_is() -> None:
    mesh = primitives.cone()
    ((drawn, material, matrix),) = meshes_of(Surface(mesh), MATERIAL)
    assert drawn is mesh
    assert material is MATERIAL
    np.testing.assert_array_equal(matrix, np.eye(4))


def cloud(**channels: object) -> PointCloud:
    points = np.array([[0, 0, 0], [1, 0, 0], [math.nan, 0, 0], [0, 2, 0]], np.float32)
    return PointCloud(points, {name: np.asarray(value, np.float32) for name, value in channels.items()})


def test_points_keep_finite_points_with_their_colours() -> None:
    rgb = [[1, 0, 0], [0, 2, 0], [9, 9, 9], [0, -1, math.nan]]
    ((mesh, material, _),) = meshes_of(cloud(rgb=rgb, intensity=[0, 0, 0, 0]), MATERIAL)
    assert mesh.topology is Topology.POINTS
    np.testing.assert_array_equal(mesh.positions, [[0, 0, 0], [1, 0, 0], [0, 2, 0]])
    np.testing.assert_array_equal(mesh.colors, [[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 0, 1]])
    assert material.base_color == (1.0, 1.0, 1.0, 0.5)


def test_intensity_is_grey_and_rgba_keeps_its_alpha() -> None:
    half, quarter = linear_from_srgb(0.5), linear_from_srgb(0.25)
    ((mesh, _, _),) = meshes_of(cloud(intensity=[0, 0.5, 0, 1]), MATERIAL)
    grey = np.array([[0, 0, 0, 1], [half, half, half, 1], [1, 1, 1, 1]])
    np.testing.assert_allclose(mesh.colors, grey, rtol=1e-6)
    ((mesh, _, _),) = meshes_of(cloud(rgb=np.full((4, 4), 0.25)), MATERIAL)
    np.testing.assert_allclose(mesh.colors, np.array([[quarter, quarter, quarter, 0.25]] * 3), rtol=1e-6)


@pytest.mark.parametrize("channels", [{}, {"rgb": []}, {"rgb": [[1, 1, 1]]}, {"intensity": []}, {"intensity": [1, 2]}])
def test_channels_of_the_wrong_length_leave_the_flat_colour(channels: Any) -> None:
    ((mesh, material, _),) = meshes_of(cloud(**channels), MATERIAL)
    assert mesh.colors is None
    assert material.base_color == MATERIAL.base_color


def test_the_triad_points_along_the_axes_in_red_green_blue() -> None:
    ((mesh, material, matrix),) = meshes_of(Triad(0.5), MATERIAL)
    assert mesh.topology is Topology.LINES
    tips = (mesh.positions[mesh.elements[:, 1]] @ matrix[:3, :3].T).astype(float)
    np.testing.assert_allclose(tips, np.eye(3) * 0.5)
    np.testing.assert_array_equal(mesh.colors[mesh.elements[:, 1], :3], np.eye(3))
    assert material.base_color == (1.0, 1.0, 1.0, 0.5)


def test_triad_tubes_are_two_millimetres_whatever_the_scale() -> None:
    np.testing.assert_allclose(bounds(Triad(1.0, tube=True)), [[-0.002] * 3, [1.0] * 3], atol=1e-6)
    np.testing.assert_allclose(bounds(Triad(5.0, tube=True)), [[-0.002] * 3, [5.0] * 3], atol=1e-6)
    solid = placed(Triad(0.3, tube=True))[0]
    assert solid.volume == pytest.approx(3 * math.pi * 0.002**2 * 0.3, rel=0.02)


def test_far_triad_tubes_are_never_thinner_than_hairlines() -> None:
    tubes, hairlines = meshes_of(Triad(0.5, tube=True), MATERIAL)
    assert tubes[0].topology is Topology.TRIANGLES
    (alone,) = meshes_of(Triad(0.5), MATERIAL)
    assert hairlines[:2] == alone[:2]
    np.testing.assert_array_equal(hairlines[2], alone[2])


def line(*points: tuple[float, float, float], **options: Any) -> Line:
    return Line(np.array(points, np.float32), **options)


def test_a_straight_tube_is_a_closed_cylinder() -> None:
    shape = line((0, 0, 0), (0, 0, 1), (0, 0, 3), radius=0.1)
    (solid,) = placed(shape)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(math.pi * 0.01 * 3, rel=0.02)
    np.testing.assert_allclose(bounds(shape), [(-0.1, -0.1, 0), (0.1, 0.1, 3)], atol=1e-6)


@pytest.mark.parametrize("closed", [False, True])
def test_a_curved_tube_has_no_gaps_and_the_volume_of_pappus(closed: Any) -> None:
    angle = np.linspace(0, 2 * math.pi, 80, endpoint=False)
    knot = np.stack(
        (np.cos(angle) * (3 + np.cos(3 * angle)), np.sin(angle) * (3 + np.cos(3 * angle)), np.sin(3 * angle))
    )
    points = knot.T.astype(np.float32)
    (solid,) = placed(Line(points, radius=0.1, closed=closed))
    path = np.concatenate((points, points[:1])) if closed else points
    length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert solid.is_watertight
    assert solid.is_winding_consistent
    assert solid.volume == pytest.approx(math.pi * 0.01 * length, rel=0.02)
    assert solid.euler_number == (0 if closed else 2)


@pytest.mark.parametrize("turn", [30, 85, 100, 135, 170, 180])
def test_every_bend_is_covered(turn: Any) -> None:
    """Around the joint, on the side away from the bend, no point of the tube's surface is missing."""
    a = math.radians(turn)
    shape = line((-1, 0, 0), (0, 0, 0), (math.cos(a), math.sin(a), 0), radius=0.1)
    (mesh, _, _), *_ = meshes_of(shape, MATERIAL)
    solid = trimesh.Trimesh(mesh.positions, mesh.elements, process=False)
    for lean in np.linspace(0.05, a - 0.05, 7):
        direction = np.array((math.sin(lean), -math.cos(lean), 0.0))
        assert ray_hits(solid, direction * 0.5, -direction), lean


def ray_hits(solid: trimesh.Trimesh, origin: np.ndarray, direction: np.ndarray) -> bool:
    """Return True if a ray hits a triangle within 0.45: Moeller and Trumbore's test on all triangles."""
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))
    e1, e2 = b - a, c - a
    p = np.cross(direction, e2)
    determinant = (e1 * p).sum(axis=1)
    with np.errstate(all="ignore"):
        s = origin - a
        u = (s * p).sum(axis=1) / determinant
        q = np.cross(s, e1)
        v = (q @ direction) / determinant
        t = (e2 * q).sum(axis=1) / determinant
    return bool(((u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t > 0) & (t < 0.45)).any())


@pytest.mark.parametrize("radius", [0.0, -1.0, math.nan])
def test_a_line_without_radius_is_a_hairline(radius: Any) -> None:
    ((mesh, _, _),) = meshes_of(line((0, 0, 0), (1, 0, 0), (1, 1, 0), radius=radius), MATERIAL)
    np.testing.assert_array_equal(mesh.elements, [(0, 1), (1, 2)])
    ((mesh, _, _),) = meshes_of(line((0, 0, 0), (1, 0, 0), (1, 1, 0), radius=radius, closed=True), MATERIAL)
    np.testing.assert_array_equal(mesh.elements, [(0, 1), (1, 2), (2, 0)])


def test_arrow_heads_end_at_the_end_points_and_shorten_the_shaft() -> None:
    shape = line((0, 0, 0), (0, 0, 1), radius=0.01, start_head=True, end_head=True, head_radius=0.05, head_length=0.2)
    shaft, *heads = placed(shape)
    np.testing.assert_allclose(shaft.bounds[:, 2], (0.1, 0.9), atol=1e-6)
    np.testing.assert_allclose([head.bounds[:, 2] for head in heads], [(0, 0.2), (0.8, 1)], atol=1e-6)
    for head in heads:
        assert head.is_watertight
        assert head.volume == pytest.approx(math.pi * 0.05**2 * 0.2 / 3, rel=0.02)


def test_the_head_length_defaults_to_the_head_radius_and_hairlines_have_heads() -> None:
    shape = line((0, 0, 0), (2, 0, 0), radius=0, end_head=True, head_radius=0.3)
    (head,) = placed(shape)
    np.testing.assert_allclose(head.bounds[:, 0], (1.7, 2.0), atol=1e-6)
    (shaft, _, _), _ = meshes_of(shape, MATERIAL)
    assert shaft.positions[:, 0].max() == pytest.approx(1.85)


def test_a_line_shorter_than_its_heads_still_points_the_right_way() -> None:
    shape = line((0, 0, 0), (0, 0, 0.1), end_head=True, start_head=True, head_radius=1, head_length=2)
    (shaft, _, _), *_ = meshes_of(shape, MATERIAL)
    assert 0 < shaft.positions[:, 2].min() < shaft.positions[:, 2].max() < 0.1


def test_long_lines_stay_within_the_vertex_budget() -> None:
    angle = np.linspace(0, 100, 50_000)
    points = np.stack((np.cos(angle), np.sin(angle), angle), axis=1).astype(np.float32)
    ((mesh, _, _),) = meshes_of(Line(points), MATERIAL)
    assert len(mesh.positions) < 450_000
    many = np.concatenate([points + offset for offset in range(4)])
    ((mesh, _, _),) = meshes_of(Line(many), MATERIAL)
    assert mesh.topology is Topology.LINES


def test_meshes_of_lines_are_cached_with_their_shape() -> None:
    shape = line((0, 0, 0), (1, 0, 0))
    (first, _, _), (second, _, _) = meshes_of(shape, MATERIAL)[0], meshes_of(shape, Material())[0]
    assert first is second
    kept = weakref.ref(first)
    del first, second, shape
    gc.collect()
    assert kept() is None


any_float = st.one_of(
    st.floats(-3, 3), st.sampled_from([0.0, -0.0, math.nan, math.inf, -math.inf, 1e-40, 1e30, -1e300, 1e300])
)
triples = st.tuples(any_float, any_float, any_float)
any_line = st.builds(
    lambda points, *others: Line(
        np.clip(np.array(points, np.float64).reshape(-1, 3), -3e38, 3e38).astype(np.float32), *others
    ),
    st.lists(triples, max_size=6),
    any_float,
    st.booleans(),
    st.booleans(),
    st.booleans(),
    any_float,
    st.none() | any_float,
)


@given(solids(any_float) | any_line)
@settings(deadline=None, max_examples=400)
def test_no_value_raises_and_every_mesh_is_well_formed(shape: Any) -> None:
    for mesh, _, matrix in meshes_of(shape, MATERIAL):
        assert matrix.shape == (4, 4)
        assert np.isfinite(matrix).all()
        assert mesh.positions.dtype == np.float32
        assert mesh.elements.dtype == np.uint32
        assert mesh.elements.flags.c_contiguous
        assert mesh.positions.flags.c_contiguous
        assert mesh.elements.size == 0 or mesh.elements.max() < len(mesh.positions)
        assert np.isfinite(mesh.positions).all()
        assert mesh.normals is None or np.isfinite(mesh.normals).all()


@pytest.mark.parametrize(
    ("extent", "drawn"), [(MIN_EXTENT, 1), (MIN_EXTENT / 2, 0), (MAX_EXTENT, 1), (2 * MAX_EXTENT, 0)]
)
@pytest.mark.parametrize("make", [Sphere, lambda size: Box((0, size, 0)), lambda size: Triad(-size)])
def test_the_smallest_and_the_largest_extents_are_drawn(make: Any, extent: float, drawn: int) -> None:
    assert len(meshes_of(make(extent), MATERIAL)) == drawn


def test_the_ends_of_slender_capsules_are_left_out() -> None:
    ((capsule, _, _),) = meshes_of(Capsule(1.0, MAX_CAPSULE_ASPECT), MATERIAL)
    ((cylinder, _, _),) = meshes_of(Capsule(1.0, 1.001 * MAX_CAPSULE_ASPECT), MATERIAL)
    assert cylinder is primitives.cylinder()
    assert capsule is not cylinder


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("value", [-1e13, -2 * MAX_EXTENT, math.nan, -math.inf])
def test_points_beyond_the_largest_extent_are_left_out(axis: int, value: float) -> None:
    points = np.ones((2, 3), np.float32)
    points[1, axis] = value
    ((mesh, _, _),) = meshes_of(PointCloud(points), MATERIAL)
    assert len(mesh.positions) == (2 if value == -1e13 else 1)


@pytest.mark.parametrize(
    ("shape", "casts_shadow"),
    [
        (Triad(1.0, True), False),
        (Line(np.eye(3, dtype=np.float32), radius=0.01, head_radius=0.02, end_head=True), False),
        (Line(np.eye(3, dtype=np.float32), radius=0.01), True),
        (Box((1.0, 1.0, 1.0)), True),
    ],
    ids=["triad", "arrow", "line", "box"],
)
def test_marks_cast_no_shadows(shape: Shape, casts_shadow: bool) -> None:
    assert {material.casts_shadow for _, material, _ in meshes_of(shape, Material())} == {casts_shadow}
