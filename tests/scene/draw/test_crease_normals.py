import math

import numpy as np
import pytest

from gateway.scene.draw import crease_normals
from gateway.scene.draw.crease_normals import (
    MAX_FACES_PER_VERTEX,
    NO_CREASES,
    smooth_mesh,
    smooth_vertices,
    with_creases,
)
from renderers import primitives
from renderers.drawlist import Mesh
from renderers.stop import StopFlag


def torn(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """The same surface with three vertices of its own for every triangle, as STL stores it."""
    positions = np.ascontiguousarray(mesh.positions[mesh.elements].reshape(-1, 3))
    return positions, np.arange(len(positions), dtype=np.uint32).reshape(-1, 3)


def test_a_cylinder_keeps_its_edges() -> None:
    source = primitives.cylinder()
    mesh = with_creases(*torn(source))
    flat = np.abs(mesh.normals[:, 2]) > 0.999
    round_ = np.abs(mesh.normals[:, 2]) < 0.001
    assert (flat | round_).all()
    # Two triangles of one facet and one of the next lie around a vertex: a sixth of its angle aside.
    facet = 2 * math.pi / (np.count_nonzero(round_) / 2)
    np.testing.assert_allclose(mesh.normals[round_][:, :2], mesh.positions[round_][:, :2], atol=facet / 5)


def test_texture_coordinates_and_colours_stay_with_their_corners() -> None:
    positions, triangles = torn(primitives.box())
    uv = np.random.default_rng(3).random((len(positions), 2), np.float32)
    colors = np.random.default_rng(4).random((len(positions), 4), np.float32)
    mesh = with_creases(positions, triangles, uv=uv, colors=colors)
    np.testing.assert_array_equal(mesh.positions[mesh.elements], positions[triangles])
    np.testing.assert_array_equal(mesh.uv0[mesh.elements], uv[triangles])
    np.testing.assert_array_equal(mesh.colors[mesh.elements], colors[triangles])


@pytest.mark.parametrize(("count", "is_flat"), [(MAX_FACES_PER_VERTEX, False), (MAX_FACES_PER_VERTEX + 4, True)])
def test_corners_of_a_vertex_with_too_many_faces_are_flat(count: int, is_flat: bool) -> None:
    """The tip of a pyramid: each of its four sides is a fan of faces that differ a little in direction."""
    side = np.arange(count) * 4 // count
    bend = np.arange(count) * 4 / count - side - 0.5
    angle = (side + 0.5 + 0.02 * bend) * math.pi / 2
    outward = np.stack((np.cos(angle), np.sin(angle), np.full(count, 0.2)), axis=1)
    along = np.cross(outward, (0, 0, 1))
    corners = np.stack(
        (np.zeros((count, 3)), np.cross(outward, along) + along, np.cross(outward, along) - along), axis=1
    )
    positions = np.concatenate((np.zeros((1, 3)), corners[:, 1:].reshape(-1, 3))).astype(np.float32)
    index = np.arange(count, dtype=np.uint32)
    faces = np.stack((np.zeros_like(index), 2 * index + 1, 2 * index + 2), axis=1)
    out_positions, _, normals = smooth_mesh(positions, faces)
    tip_vertices = int((out_positions == 0.0).all(axis=1).sum())
    assert (tip_vertices > 4) is is_flat
    assert tip_vertices >= 4
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)


def test_degenerate_triangles_and_none_at_all() -> None:
    points = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0)], np.float32)
    mesh = with_creases(points, np.array([(0, 1, 2), (0, 0, 0)], np.uint32))
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-6)
    assert len(with_creases(points, np.zeros((0, 3), np.uint32)).elements) == 0


def test_normals_are_smooth_up_to_creases_of_45_degrees() -> None:
    def roof(angle: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        c, s = np.cos(angle), np.sin(angle)
        positions = np.array([[0, 0, 0], [0, 1, 0], [-1, 0, 0], [c, 0, -s], [9, 9, 9]], np.float32)
        return smooth_mesh(positions, np.array([[0, 1, 2], [0, 3, 1]], np.uint32))

    gentle, elements, normals = roof(np.radians(44))
    assert len(gentle) == 4, "the vertices of the ridge are shared, the unused one is left out"
    ridge = normals[elements[0, 0]]
    np.testing.assert_allclose(ridge, (np.sin(np.radians(22)), 0, np.cos(np.radians(22))), atol=1e-6)
    sharp, elements, normals = roof(np.radians(46))
    assert len(sharp) == 6
    np.testing.assert_allclose(normals[elements[0]], np.tile((0, 0, 1), (3, 1)), atol=1e-6)


@pytest.mark.parametrize("faces", [((0, 1, 2), (0, 3, 1)), ((0, 3, 1), (0, 1, 2))], ids=["small first", "large first"])
def test_a_small_face_beside_a_large_one_keeps_its_own_normal(faces: tuple[tuple[int, ...], ...]) -> None:
    """The mean normal is almost that of the large face."""
    positions = np.array([(0, 0, 0), (0, 1, 0), (-0.01, 0, 0), (0.5, 0, -math.sqrt(0.75))], np.float32)
    out_positions, out_faces, normals = smooth_mesh(positions, np.array(faces, np.uint32))
    assert len(out_positions) == 6
    small = out_faces[faces.index((0, 1, 2))]
    np.testing.assert_allclose(normals[small], np.tile((0, 0, 1), (3, 1)), atol=1e-6)


def test_a_vertex_with_many_faces_takes_linear_time() -> None:
    """All normals differ. The comparison of each face with each other one would take minutes."""
    count = 1_000_000
    chance = np.random.default_rng(3)
    rim = chance.normal(size=(count + 1, 3)).astype(np.float32)
    positions = np.concatenate((np.zeros((1, 3), np.float32), rim))
    index = np.arange(1, count + 1, dtype=np.uint32)
    faces = np.stack((np.zeros_like(index), index, index + 1), axis=1)
    placed, elements, normals = smooth_mesh(positions, faces)
    assert len(normals) > 2 * count
    np.testing.assert_array_equal(placed[elements[::1000]], positions[faces[::1000]])


def test_the_stop_flag_ends_the_kernel() -> None:
    flag = StopFlag()
    flag.set(TimeoutError("late"))
    with pytest.raises(TimeoutError, match="late"):
        flag.run(lambda: smooth_mesh(np.zeros((3, 3), np.float32), np.array([(0, 1, 2)], np.uint32)))


def test_without_creases_normals_are_summed_by_area_per_vertex_index() -> None:
    """A floor and a wall thrice as large share an edge; a vertex at the same place but of its own stays flat."""
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 3), (0, 0, 0)], np.float32)
    triangles = np.array([(0, 1, 2), (0, 3, 1), (4, 1, 2)], np.uint32)
    vertices, faces, normals = smooth_vertices(positions, triangles, NO_CREASES)
    assert vertices.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_array_equal(faces, triangles)
    shared = np.array((0, 3, 1)) / np.sqrt(10)  # 1 * (0, 0, 1) + 3 * (0, 1, 0), as cross products
    np.testing.assert_allclose(normals[0], shared, atol=1e-6)
    np.testing.assert_allclose(normals[4], (0, 0, 1), atol=1e-6)
    np.testing.assert_allclose(normals[2], (0, 0, 1), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)


def test_without_creases_opposite_faces_of_the_same_vertices_have_their_own_normals() -> None:
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)
    triangles = np.array([(0, 1, 2), (0, 2, 1)], np.uint32)
    vertices, faces, normals = smooth_vertices(positions, triangles, NO_CREASES)
    assert vertices.tolist() == [0, 0, 1, 1, 2, 2]
    np.testing.assert_array_equal(normals[faces][:, :, 2], [[1, 1, 1], [-1, -1, -1]])


def test_without_creases_the_tip_of_a_cone_of_many_faces_has_one_normal() -> None:
    count = MAX_FACES_PER_VERTEX * 4
    angle = np.linspace(0, 2 * math.pi, count, endpoint=False)
    points = np.concatenate((np.stack((np.cos(angle), np.sin(angle), 0 * angle), axis=1), [(0, 0, 1)]))
    ring = np.arange(count)
    triangles = np.stack((ring, np.roll(ring, -1), np.full(count, count)), axis=1).astype(np.uint32)
    vertices, _, normals = smooth_vertices(points.astype(np.float32), triangles, NO_CREASES)
    assert len(vertices) == count + 1
    np.testing.assert_allclose(normals[-1], (0, 0, 1), atol=1e-5)


def test_writable_and_read_only_arrays_share_one_compiled_signature() -> None:
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0)], np.float32)
    triangles = np.array([(0, 1, 2)], np.uint32)
    for writable in (True, False):
        positions.flags.writeable = triangles.flags.writeable = writable
        smooth_vertices(positions, triangles)
        assert positions.flags.writeable is writable
    kernel = crease_normals._split_at_creases  # noqa: SLF001 - another signature would be compiled while serving
    assert len(kernel.signatures) == 1
