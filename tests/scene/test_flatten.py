from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from gateway.scene import transforms as tf
from gateway.scene.flatten import Flattener, flatten
from gateway.scene.geometry import Box, Capsule, Line, Part, Sphere, Surface, Triad
from gateway.scene.labels import MAX_LABELS, LabelTable
from gateway.scene.live import LiveTree, Snapshot
from gateway.scene.tree import Node, Path, TreeEdit
from renderers import primitives
from renderers.drawlist import LABEL_NONE, DrawList, Image, Material, Texture

RED = Material(base_color=(1, 0, 0, 1))
IMAGES = [Image(bytes([index]), lambda: np.zeros((1, 1, 4), np.uint8)) for index in range(2)]
SHAPES = [
    Part(Box((1, 2, 3)), RED),
    Part(Sphere(0.5), Material(base_color_texture=Texture(IMAGES[0])), tf.translation(0, 0, 1)),
    Part(Surface(primitives.cone()), Material(emissive_texture=Texture(IMAGES[1])), tf.scaling(1, -2, 3)),
    Part(Triad(1.0), RED),
    Part(Line(np.array([(0, 0, 0), (1, 0, 0)], np.float32), end_head=True), RED),
    Part(Capsule(0, 0), RED),
]
WILD = Part(Box((1, 1, 1)), RED, np.full((4, 4), math.nan))


def naive(root: Node, labels: LabelTable) -> list[tuple[Any, ...]]:
    """What a draw list must hold, by the definition: product of all transforms from the root, one node at a time."""
    from gateway.scene.meshing import meshes_of

    out = []
    stack: list[tuple[Path, Node, np.ndarray]] = [((), root, np.eye(4))]
    while stack:
        path, node, world = stack.pop()
        if not node.visible:
            continue
        with np.errstate(all="ignore"):
            world = world @ node.matrix
            for part in node.parts or ():
                for mesh, material, matrix in meshes_of(part.shape, part.material):
                    X = world @ part.X_node_part @ matrix
                    if (np.abs(X) < 1e15).all():
                        out.append((mesh, material, X, labels.label_of(path)))
        stack.extend(((*path, name), child, world) for name, child in reversed(node.children.items()))
    return out


def assert_draws(drawn: DrawList, expected: list[tuple[Any, ...]]) -> None:
    assert len(drawn.instances) == len(expected)
    for index, (instance, (mesh, material, X, label)) in enumerate(zip(drawn.instances, expected, strict=True)):
        assert instance.mesh is mesh
        assert instance.material == material
        assert instance.label == label
        assert instance.instance_id == index
        np.testing.assert_allclose(instance.X_world_mesh, X, rtol=1e-9, atol=1e-9)
    textures = [i.material.base_color_texture or i.material.emissive_texture for i in drawn.instances]
    assert list(drawn.images) == list(dict.fromkeys(t.image for t in textures if t is not None))


paths = st.lists(st.sampled_from(["a", "b", 1, 2]), max_size=3).map(tuple)
deep = st.tuples(st.integers(0, 12)).map(lambda n: ("d",) * n[0])
coordinate = st.one_of(st.floats(-9, 9), st.sampled_from([math.nan, math.inf, 1e200]))
poses = st.tuples(*[coordinate] * 3, st.just(1.0), *[st.floats(-1, 1)] * 3)
tame = st.tuples(*[st.floats(-9, 9)] * 3, st.just(1.0), *[st.floats(-1, 1)] * 3)


class FlattenMachine(RuleBasedStateMachine):
    """Random edits: what the incremental flattener makes equals the definition, and the one-shot function."""

    @initialize()
    def start(self) -> None:
        self.live = LiveTree()
        self.labels = LabelTable()
        self.flattener = Flattener(self.labels)

    @rule(path=st.one_of(paths, deep), parts=st.lists(st.sampled_from([*SHAPES, WILD]), max_size=3))
    def set_parts(self, path: Path, parts: list[Part]) -> None:
        with self.live.edit() as edit:
            edit.set_parts(path, tuple(parts))

    @rule(moves=st.lists(st.tuples(st.one_of(paths, deep), st.one_of(tame, poses)), min_size=1, max_size=12))
    def set_poses(self, moves: list[tuple[Path, Any]]) -> None:
        with self.live.edit() as edit:
            for path, pose in moves:
                edit.set_pose(path, pose)

    @rule(path=paths)
    def set_matrix(self, path: Path) -> None:
        with self.live.edit() as edit:
            edit.set_matrix(path, tf.scaling(2, 1, -1))

    @rule(path=paths, visible=st.booleans())
    def set_visible(self, path: Path, visible: bool) -> None:
        with self.live.edit() as edit:
            edit.set_visible(path, visible)

    @rule(path=paths)
    def delete(self, path: Path) -> None:
        with self.live.edit() as edit:
            edit.delete(path)

    @rule(source=paths, destination=paths)
    def share_a_subtree(self, source: Path, destination: Path) -> None:
        node = self.live.snapshot.root.find(source)
        if node is not None and destination:
            with self.live.edit() as edit:
                edit.set_subtree(destination, node)

    @invariant()
    def both_equal_the_definition(self) -> None:
        root = self.live.snapshot.root
        if sum(1 for _ in root.walk()) > 300:
            self.start()
            return
        expected = naive(root, self.labels)
        assert_draws(self.flattener.flatten(self.live.snapshot), expected)
        assert_draws(flatten(root, label_of=lambda path, _: self.labels.label_of(path)), expected)


FlattenMachine.TestCase.settings = settings(deadline=None, max_examples=40, stateful_step_count=20)
test_flattening_against_the_definition = FlattenMachine.TestCase


def scene(count: int) -> LiveTree:
    live = LiveTree()
    with live.edit() as edit:
        for index in range(count):
            edit.set_parts(("group", index), (SHAPES[0],))
    return live


def test_what_did_not_change_is_the_same_object():
    live = scene(20)
    flattener = Flattener(LabelTable())
    first = flattener.flatten(live.snapshot)
    assert flattener.flatten(live.snapshot) is first
    with live.edit() as edit:
        edit.set_pose(("group", 7), (1, 2, 3, 1, 0, 0, 0))
    second = flattener.flatten(live.snapshot)
    kept = [a is b for a, b in zip(first.instances, second.instances, strict=True)]
    assert kept == [index != 7 for index in range(20)]
    np.testing.assert_array_equal(second.instances[7].X_world_mesh[:3, 3], (1, 2, 3))
    np.testing.assert_array_equal(first.instances[7].X_world_mesh[:3, 3], (0, 0, 0))


def test_labels_stay_with_the_path_when_the_tree_changes():
    live = scene(3)
    labels = LabelTable()
    flattener = Flattener(labels)
    before = [instance.label for instance in flattener.flatten(live.snapshot).instances]
    with live.edit() as edit:
        edit.delete(("group", 0))
        edit.set_parts(("new",), (SHAPES[0],))
    after = flattener.flatten(live.snapshot).instances
    assert [instance.label for instance in after][:2] == before[1:]
    assert [labels.path_of(i.label) for i in after] == [("group", 1), ("group", 2), ("new",)]
    assert [instance.instance_id for instance in after] == [0, 1, 2]


def test_without_labels_everything_is_unlabelled():
    assert {i.label for i in flatten(scene(2).snapshot.root).instances} == {LABEL_NONE}


def test_a_failure_in_between_does_not_leave_half_a_scene(monkeypatch):
    live = scene(2)
    flattener = Flattener(LabelTable())
    flattener.flatten(live.snapshot)
    with live.edit() as edit:
        edit.set_pose(("group", 0), (5, 0, 0, 1, 0, 0, 0))
        edit.set_parts(("group", 1), (SHAPES[1],))

    def broken(*_: object) -> Any:
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr("gateway.scene.flatten.meshes_of", broken)
        with pytest.raises(MemoryError):
            flattener.flatten(live.snapshot)
    assert_draws(flattener.flatten(live.snapshot), _again(live))


def _again(live: LiveTree) -> list[tuple[Any, ...]]:
    labels = LabelTable()
    Flattener(labels).flatten(live.snapshot)
    return naive(live.snapshot.root, labels)


def test_a_chain_of_thousands_of_nodes():
    edit = TreeEdit(Node())
    path: Path = ()
    for index in range(3000):
        path = (*path, index)
    edit.set_parts(path, (SHAPES[0],))
    for depth in (1, 1500, 3000):
        edit.set_pose(path[:depth], (1, 0, 0, 1, 0, 0, 0))
    (instance,) = flatten(edit.commit()).instances
    assert instance.X_world_mesh[0, 3] == 3.0


def test_labels_are_dense_bounded_and_thread_safe():
    table = LabelTable(limit=100)
    with ThreadPoolExecutor(4) as pool:
        rounds = list(pool.map(lambda _: [table.label_of((k,)) for k in range(150)], range(8)))
    given = {path: label for label, path in table.known().items()}
    assert sorted(given.values()) == list(range(1, 101))
    for labels in rounds:
        for k, label in enumerate(labels):
            assert label == given.get((k,), LABEL_NONE)
    assert table.path_of(given[(3,)]) == (3,)
    assert table.path_of(0) is None
    assert table.path_of(101) is None
    assert table.path_of(LABEL_NONE) is None


@pytest.mark.parametrize("limit", [0, -1, MAX_LABELS + 1])
def test_the_label_limit_has_24_bits(limit):
    with pytest.raises(ValueError, match="label limit"):
        LabelTable(limit)


def test_an_empty_or_hidden_tree_draws_nothing():
    assert flatten(Node()).instances == ()
    live = scene(3)
    flattener = Flattener(LabelTable())
    assert len(flattener.flatten(live.snapshot).instances) == 3
    with live.edit() as edit:
        edit.set_visible((), False)
    assert flattener.flatten(live.snapshot).instances == ()
    with live.edit() as edit:
        edit.set_visible((), True)
    assert len(flattener.flatten(Snapshot(live.snapshot.root, 9)).instances) == 3
