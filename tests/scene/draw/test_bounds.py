from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gateway.scene.draw import bounds as bd
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.nodes import Node, TreeEdit
from renderers import primitives
from renderers.drawlist import DrawList, Instance, Material, Mesh
from scenegate.messages.geometry import Box, Sphere
from tests.support.bounds import scene_bounds

MATERIAL = Material()


def brute(mesh: Mesh, X: np.ndarray) -> np.ndarray:
    points = mesh.positions[np.unique(mesh.elements)].astype(float) @ X[:3, :3].T + X[:3, 3]
    return np.array((points.min(axis=0), points.max(axis=0)))


def transformed(mesh: Mesh, X: np.ndarray) -> np.ndarray:
    (box,) = bd.instance_bounds([Instance(mesh, MATERIAL, X)])
    assert box is not None
    return box


affine = hnp.arrays(np.float64, (3, 4), elements=st.floats(-5, 5)).map(lambda a: np.vstack((a, (0, 0, 0, 1))))


def test_unused_vertices_do_not_count() -> None:
    positions = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (99, 99, 99), (np.nan, 0, 0)], np.float32)
    mesh = Mesh(positions, np.array([(0, 1, 2)], np.uint32))
    np.testing.assert_array_equal(bd.mesh_bounds(mesh), [(0, 0, 0), (1, 1, 0)])
    assert bd.mesh_bounds(Mesh(positions, np.zeros((0, 3), np.uint32))) is None


@pytest.mark.parametrize("count", [5, bd.EXACT_VERTICES + 1])
def test_vertices_that_are_not_finite_do_not_count(count: int) -> None:
    positions = np.random.default_rng(2).random((count, 3)).astype(np.float32)
    mesh = Mesh(positions.copy(), np.arange(count, dtype=np.uint32)[:, None])
    mesh.positions[0, 0], mesh.positions[2, 1], mesh.positions[3, 2] = np.nan, np.inf, -np.inf
    kept = positions[[1, *range(4, count)]]
    np.testing.assert_array_equal(bd.mesh_bounds(mesh), (kept.min(axis=0), kept.max(axis=0)))
    assert np.isfinite(transformed(mesh, tf.from_pose((5, 0, 0), (0.9, 0.3, 0.1, 0.2)))).all()
    mesh.positions[:] = np.nan
    assert bd.mesh_bounds(Mesh(mesh.positions, mesh.elements)) is None


@pytest.mark.parametrize("corner", [(9, 9, 9), (-9, -9, -9), (9, -9, 9), (-9, 9, -9)])
def test_a_single_corner_vertex_of_a_large_mesh_counts(corner: tuple[float, float, float]) -> None:
    """The vertex with the largest coordinates is at the very edge of the grid."""
    positions = np.random.default_rng(1).random((bd.EXACT_VERTICES + 1, 3)).astype(np.float32)
    positions[-1] = corner
    mesh = Mesh(positions, np.arange(len(positions), dtype=np.uint32)[:, None])
    np.testing.assert_array_equal(bd.mesh_bounds(mesh), brute(mesh, np.eye(4)))
    X = tf.from_pose((0, -1e3, 0), (0.9, 0.3, 0.1, 0.2))
    found, true = transformed(mesh, X), brute(mesh, X)
    assert (found[0] <= true[0] + 1e-9).all()
    assert (found[1] >= true[1] - 1e-9).all()
    assert np.abs(found - true).max() < 1.8 * 10 / 12


def test_meshes_are_exact_up_to_the_limit() -> None:
    positions = np.random.default_rng(1).normal(size=(bd.EXACT_VERTICES, 3)).astype(np.float32)
    mesh = Mesh(positions, np.arange(len(positions), dtype=np.uint32)[:, None])
    X = tf.from_pose((5, -7, 0), (0.9, 0.3, 0.1, 0.2))
    np.testing.assert_allclose(transformed(mesh, X), brute(mesh, X), atol=1e-9)


@given(st.lists(st.tuples(affine, st.sampled_from([primitives.box(), primitives.sphere()])), min_size=1, max_size=8))
def test_instance_bounds_and_loose_bounds(placed: Any) -> None:
    instances = tuple(Instance(mesh, MATERIAL, X) for X, mesh in placed)
    boxes = bd.instance_bounds(instances)
    for box, instance in zip(boxes, instances, strict=True):
        np.testing.assert_allclose(box, brute(instance.mesh, instance.X_world_mesh), atol=1e-9)
    exact, loose = scene_bounds(DrawList(instances)), bd.loose_bounds(DrawList(instances))
    assert (loose[0] <= exact[0] + 1e-9).all()
    assert (loose[1] >= exact[1] - 1e-9).all()
    assert (loose[1] - loose[0] <= 1.8 * (exact[1] - exact[0]) + 1e-6).all()


def scene(*parts: tuple[str, Part, np.ndarray]) -> Node:
    edit = TreeEdit(Node())
    for name, part, X in parts:
        edit.set_parts((name,), (part,))
        edit.set_matrix((name,), X)
    return edit.commit()


def assert_box(found: bd.Bounds | None, expected: list[tuple[float, float, float]]) -> None:
    np.testing.assert_allclose(found, np.array(expected), atol=1e-6)


def test_scene_and_focus_bounds() -> None:
    ground = ("ground", Part(Box((100, 100, 0.1)), MATERIAL), tf.translation(0, 0, -0.05))
    ball = ("ball", Part(Sphere(0.5), MATERIAL), tf.translation(1, 0, 0.5))
    both = flatten(scene(ground, ball))
    assert_box(scene_bounds(both), [(-50, -50, -0.1), (50, 50, 1)])
    assert_box(bd.focus_bounds(both), [(0.5, -0.5, 0), (1.5, 0.5, 1)])
    alone = flatten(scene(ground))
    assert_box(bd.focus_bounds(alone), [(-50, -50, -0.1), (50, 50, 0)])
    assert scene_bounds(DrawList()) is None
    assert bd.focus_bounds(DrawList()) is None


def test_a_small_table_top_stays_in_focus() -> None:
    top = ("top", Part(Box((1.5, 1, 0.01)), MATERIAL), tf.translation(0, 0, -0.5))
    ball = ("ball", Part(Sphere(0.5), MATERIAL), np.eye(4))
    assert_box(bd.focus_bounds(flatten(scene(top, ball))), [(-0.75, -0.5, -0.505), (0.75, 0.5, 0.5)])


def test_world_matrices_multiply_from_the_root_down() -> None:
    edit = TreeEdit(Node())
    edit.set_matrix((), tf.translation(0, 0, 10))
    edit.set_matrix(("a",), tf.scaling(2, 2, 2))
    edit.set_matrix(("a", "b"), tf.translation(1, 0, 0))
    root = edit.commit()
    np.testing.assert_array_equal(root.world_matrix(("a", "b")), tf.translation(2, 0, 10) @ tf.scaling(2, 2, 2))
    assert root.world_matrix(("a", "c", "d")) is None
