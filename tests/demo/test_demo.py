import numpy as np
import pytest
from numpy.typing import NDArray

from gateway import demo
from gateway.demo import PERIOD, ROOT, Demo
from gateway.files.gltf import read_gltf
from gateway.files.gltf.export import export_glb
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import changes
from tests.support.bounds import scene_bounds


def at(t: float) -> LiveTree:
    tree = LiveTree()
    scene = Demo(tree)
    scene.populate()
    scene.move_to(t)
    return tree


def matrices(tree: LiveTree) -> NDArray[np.float64]:
    return np.array([instance.X_world_mesh for instance in flatten(tree.snapshot.root).instances])


@pytest.mark.parametrize("t", [0.0, 3.7, 1e6])
def test_scene_is_a_function_of_time(t: float) -> None:
    other = at(9.0)
    Demo(other).move_to(2.0)
    Demo(other).move_to(t)
    np.testing.assert_array_equal(matrices(at(t)), matrices(other))


def test_scene_is_periodic() -> None:
    np.testing.assert_allclose(matrices(at(5.0)), matrices(at(5.0 + PERIOD)), atol=1e-9)


def test_edit_is_one_revision_of_transforms() -> None:
    tree = LiveTree()
    scene = Demo(tree)
    scene.populate()
    before = tree.snapshot
    scene.move_to(1.0)
    assert tree.snapshot.revision == before.revision + 1
    found = list(changes(before.root, tree.snapshot.root))
    assert {change.kind for change in found} == {"transform"}
    assert {change.path for change in found} == {(*ROOT, *path) for path in demo.poses(1.0)}


def test_scene_stays_within_its_bounds() -> None:
    for t in np.linspace(0.0, PERIOD, 13).tolist():
        bounds = scene_bounds(flatten(at(t).snapshot.root))
        assert bounds is not None
        assert bounds[0, 2] >= -0.02
        assert (np.abs(bounds) <= 3.001).all()


def test_gripper_stays_above_the_table() -> None:
    for t in np.linspace(0.0, PERIOD, 49):
        drawn = flatten(at(float(t)).snapshot.root, label_of=lambda path, _: int("wrist" in path))
        for instance in drawn.instances:
            if instance.label == 1:
                points = instance.mesh.positions @ instance.X_world_mesh[:3, :3].T + instance.X_world_mesh[:3, 3]
                assert points[:, 2].min() > 0.75, t


def test_populate_resets_the_scene() -> None:
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_parts(("mine",), ())
    scene = Demo(tree)
    scene.populate()
    scene.move_to(4.0)
    scene.populate()
    np.testing.assert_array_equal(matrices(tree), matrices(at(0.0)))
    assert tree.snapshot.root.find(("mine",)) is not None


def test_export_contains_everything() -> None:
    tree = at(2.0)
    read = read_gltf(export_glb(tree.snapshot.root))
    assert read.instance_count == len(flatten(tree.snapshot.root).instances)
    assert len(flatten(read.root).images) == 4
