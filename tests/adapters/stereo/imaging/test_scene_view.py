"""Scene and pose of the stereo camera in the live tree."""

import numpy as np

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.imaging.scene_view import SceneView, state_before
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.mount import Mount
from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from renderers.drawlist import Material
from scenegate.messages.geometry import Box
from tests.adapters.stereo.conftest import SMALL


def view_of(tree: LiveTree, *path: str) -> SceneView:
    mount = Mount(tf.translation(9, 9, 9) if not path else np.eye(4), path or ("head",))
    return SceneView(tree, Flattener(LabelTable()), mount)


def move(tree: LiveTree, *position: float, path: tuple[str, ...] = ("head",)) -> None:
    with tree.edit() as edit:
        edit.set_matrix(path, tf.translation(*position))


def position_of(view: SceneView) -> list[float]:
    position: list[float] = view.state().X_world_left[:3, 3].tolist()
    return position


def test_scene_and_pose_are_of_one_time() -> None:
    times = iter((10, 20))
    tree = LiveTree(lambda: next(times))
    tree.keep_recent("camera", active=True)
    with tree.edit() as edit:
        edit.set_parts(("box",), (Part(Box((1, 1, 1)), Material()),))
        edit.set_matrix(("head",), tf.translation(1, 2, 3))
    view = view_of(tree)
    with tree.edit() as edit:
        edit.delete(("box",))
        edit.set_matrix(("head",), tf.translation(4, 5, 6))
    before, after, current = view.state(19), view.state(20), view.state()
    assert (len(before.scene.instances), before.revision, before.timestamp, before.changed) == (1, 1, 19, 10)
    assert before.X_world_left[:3, 3].tolist() == [1, 2, 3]
    assert (len(after.scene.instances), after.revision, after.timestamp, after.changed) == (0, 2, 20, 20)
    assert after.X_world_left[:3, 3].tolist() == [4, 5, 6]
    assert (current.revision, current.timestamp) == (2, 20)
    assert view.camera(StereoConfig(model=SMALL), tree.snapshot).X_world_camera[:3, 3].tolist() == [4, 5, 6]


def test_a_missing_node_is_a_warning_and_the_last_pose_is_kept() -> None:
    tree = LiveTree()
    view = view_of(tree)
    assert "the stereo camera keeps its last pose" in view.warnings()[0]
    assert position_of(view) == [9, 9, 9]
    move(tree, 1, 2, 3)
    assert view.warnings() == []
    assert position_of(view) == [1, 2, 3]
    with tree.edit() as edit:
        edit.delete(("head",))
    assert position_of(view) == [1, 2, 3]
    assert "no such node" in view.warnings()[0]


def test_a_camera_on_an_inner_node_moves_with_its_ancestors() -> None:
    tree = LiveTree()
    view = view_of(tree, "robot", "head")
    move(tree, 0, 0, 2, path=("robot", "head"))
    for x in (1, 5):
        move(tree, x, 0, 0, path=("robot",))
        assert position_of(view) == [x, 0, 2]


def test_the_pose_of_an_earlier_time_is_not_the_last_one() -> None:
    now = 0
    tree = LiveTree(lambda: now)
    move(tree, 1, 2, 3)
    view, earlier, now = view_of(tree), tree.snapshot, 5_000_000_000
    move(tree, 4, 5, 6)
    assert position_of(view) == [4, 5, 6]
    with tree.edit() as edit:
        edit.delete(("head",))
    past = view.state_in(earlier, Flattener(LabelTable()))
    assert (past.X_world_left[:3, 3].tolist(), past.timestamp, past.revision) == ([1, 2, 3], 0, 1)
    assert position_of(view) == [4, 5, 6]
    assert "no such node" in view.warnings()[0]


def test_the_left_camera_has_the_models_intrinsics() -> None:
    tree = LiveTree()
    camera = view_of(tree).camera(StereoConfig(model=SMALL, near=0.5, far=20.0), tree.snapshot)
    k = SMALL.intrinsics()
    assert (camera.width, camera.height) == (320, 240)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (k.focal_length, k.focal_length, k.cx, k.cy)
    assert (camera.near, camera.far) == (0.5, 20.0)
    np.testing.assert_array_equal(camera.X_world_camera, tf.translation(9, 9, 9))


def test_a_camera_that_is_placed_elsewhere_was_not_moving() -> None:
    times = iter((0, 100_000_000))
    tree = LiveTree(lambda: next(times))
    tree.keep_recent("camera", active=True)
    view = SceneView(tree, Flattener(LabelTable()), Mount(tf.translation(1, 0, 0)))
    last = view.state(40_000_000)
    view.place(tf.translation(2, 0, 0))
    now = view.state(80_000_000)
    assert view.warnings() == []
    assert now.X_world_left[:3, 3].tolist() == [2, 0, 0]
    earlier = state_before(now, last, view.state)
    assert earlier.X_world_left[:3, 3].tolist() == [2, 0, 0]
