from __future__ import annotations

import numpy as np
import pytest

from gateway import demo
from gateway.demo import PERIOD, ROOT, Demo
from gateway.gltf import read_gltf
from gateway.gltf.export import export_glb
from gateway.scene.bounds import scene_bounds
from gateway.scene.flatten import flatten
from gateway.scene.live import LiveTree
from gateway.scene.tree import changes
from renderers.drawlist import AlphaMode, Topology


def at(t: float) -> LiveTree:
    tree = LiveTree()
    scene = Demo(tree)
    scene.populate()
    scene.edit(t)
    return tree


def matrices(tree: LiveTree) -> np.ndarray:
    return np.array([instance.X_world_mesh for instance in flatten(tree.snapshot.root).instances])


@pytest.mark.parametrize("t", [0.0, 3.7, 1e6])
def test_the_scene_is_a_function_of_time(t: float):
    other = LiveTree()
    scene = Demo(other)
    scene.populate()
    for step in (9.0, 2.0, t):
        scene.edit(step)
    np.testing.assert_array_equal(matrices(at(t)), matrices(other))


def test_it_repeats_after_its_period():
    np.testing.assert_allclose(matrices(at(5.0)), matrices(at(5.0 + PERIOD)), atol=1e-9)


def test_a_step_is_one_revision_that_only_moves_things():
    tree = LiveTree()
    scene = Demo(tree)
    scene.populate()
    before = tree.snapshot
    scene.edit(1.0)
    assert tree.snapshot.revision == before.revision + 1
    found = list(changes(before.root, tree.snapshot.root))
    assert {change.kind for change in found} == {"transform"}
    assert {change.path for change in found} == {(*ROOT, *path) for path in demo.poses(1.0)}


def test_what_moves_and_what_is_drawn_fit_together():
    drawn = set(demo.furniture())
    for path in demo.poses(0.0):
        assert any(other[: len(path)] == path for other in drawn), path


def test_everything_shows_what_the_renderers_can_do():
    instances = flatten(at(0.0).snapshot.root).instances
    assert {instance.mesh.topology for instance in instances} >= {Topology.POINTS, Topology.TRIANGLES}
    assert {instance.material.alpha_mode for instance in instances} == {AlphaMode.OPAQUE, AlphaMode.BLEND}
    assert len(flatten(at(0.0).snapshot.root).images) == 4
    assert 20 <= len(demo.furniture()) <= 40


@pytest.mark.parametrize("t", np.linspace(0.0, PERIOD, 13).tolist())
def test_nothing_leaves_the_room_or_sinks_into_the_floor(t: float):
    bounds = scene_bounds(flatten(at(t).snapshot.root))
    assert bounds is not None
    assert bounds[0, 2] >= -0.02
    assert (np.abs(bounds) <= 3.001).all()


def test_the_gripper_stays_above_the_table():
    """The arm would look broken if it reached into the wood."""
    for t in np.linspace(0.0, PERIOD, 49):
        drawn = flatten(at(float(t)).snapshot.root, label_of=lambda path, _: int("wrist" in path))
        for instance in drawn.instances:
            if instance.label == 1:
                points = instance.mesh.positions @ instance.X_world_mesh[:3, :3].T + instance.X_world_mesh[:3, 3]
                assert points[:, 2].min() > 0.75, t


def test_populating_again_starts_over_and_clearing_takes_everything_out():
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_parts(("mine",), ())
    scene = Demo(tree)
    scene.populate()
    scene.edit(4.0)
    scene.populate()
    np.testing.assert_array_equal(matrices(tree), matrices(at(0.0)))
    scene.clear()
    assert tree.snapshot.root.find(ROOT) is None
    assert tree.snapshot.root.find(("mine",)) is not None


def test_it_can_be_exported_whole():
    tree = at(2.0)
    read = read_gltf(export_glb(tree.snapshot.root))
    assert read.instance_count == len(flatten(tree.snapshot.root).instances)
    assert len(flatten(read.root).images) == 4
