import math
import random
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

from gateway.scene.draw.flatten import Flattener, flatten
from gateway.scene.draw.meshing import meshes_of
from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import Line, Part, Surface
from gateway.scene.tree.labels import MAX_LABELS, LabelTable
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.materials import faded
from gateway.scene.tree.nodes import Node, Path, TreeEdit
from renderers import primitives
from renderers.drawlist import LABEL_NONE, DrawList, Image, Light, LightKind, Material, Texture
from renderers.light_rig import MAX_LIGHTS
from scenegate.messages.geometry import Box, Capsule, Sphere, Triad

RED = Material(base_color=(1, 0, 0, 1))
IMAGES = [Image(bytes([index]), lambda: np.zeros((1, 1, 4), np.uint8)) for index in range(2)]
SHAPES = [
    Part(Box((1, 2, 3)), RED),
    Part(Sphere(0.5), Material(base_color_texture=Texture(IMAGES[0])), tf.translation(0, 0, 1)),
    Part(Surface(primitives.cone()), Material(emissive_texture=Texture(IMAGES[1])), tf.scaling(1, -2, 3)),
    Part(Triad(1.0), RED),
    Part(Line(np.array([(0, 0, 0), (1, 0, 0)], np.float32), end_head=True), RED),
    Part(Capsule(0, 0), RED),
    Part(Light(LightKind.SPOT, range=2.0), RED, tf.translation(0, 1, 0)),
]
WILD = Part(Box((1, 1, 1)), RED, np.full((4, 4), math.nan))


def naive(root: Node, labels: LabelTable) -> tuple[list[tuple[Any, ...]], list[tuple[float, ...]]]:
    """Return the expected draw list and the positions and directions of lights by the definition: node by node."""
    drawn, lights = [], []
    stack: list[tuple[Path, Node, np.ndarray, float]] = [((), root, np.eye(4), 1.0)]
    while stack:
        path, node, world, opacity = stack.pop()
        opacity *= node.opacity
        if not node.visible:
            continue
        with np.errstate(all="ignore"):
            world = world @ node.matrix
            for part in node.parts or ():
                X = world @ part.X_node_part
                if isinstance(part.shape, Light) and (np.abs(X) < 1e15).all() and X[:3, 2].any():
                    lights.append((*X[:3, 3], *(-X[:3, 2] / np.linalg.norm(X[:3, 2]))))
                for mesh, material, matrix in meshes_of(part.shape, part.material):
                    material = material if opacity == 1.0 else faded(material, opacity)
                    if (np.abs(X @ matrix) < 1e15).all():
                        drawn.append((mesh, material, X @ matrix, labels.label_of(path)))
        stack.extend(((*path, name), child, world, opacity) for name, child in reversed(node.children.items()))
    return drawn, lights


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


PATHS: list[Path] = [(), *[(a,) for a in "ab"], *[(a, b) for a in "ab" for b in ("a", 1)], ("a", "a", "b"), ("d",) * 12]
COORDINATES = (0.0, 1.5, -1.5, -1e13, 1e200, math.nan, math.inf)


class RandomEdits:
    """Random edits of a live tree, reproducible by their seed."""

    def __init__(self, seed: int) -> None:
        self.live = LiveTree()
        self._random = random.Random(seed)
        self._edits = (self._parts, self._poses, self._matrix, self._visible, self._opacity, self._delete, self._share)

    def step(self) -> str:
        edits = self._random.choices(self._edits, (6, 6, 2, 3, 3, 2, 2), k=self._random.choice((1, 1, 2, 4)))
        with self.live.edit() as batch:
            return ", ".join(f"{edit.__name__}{edit(batch)}" for edit in edits)

    def _path(self) -> Path:
        return self._random.choice(PATHS)

    def _parts(self, edit: TreeEdit) -> tuple[Any, ...]:
        path, parts = self._path(), tuple(self._random.choices([*SHAPES, WILD], k=self._random.randrange(4)))
        edit.set_parts(path, parts)
        return path, parts

    def _poses(self, edit: TreeEdit) -> tuple[Any, ...]:
        moves = []
        for _ in range(self._random.choice((1, 2, 12))):
            finite = self._random.random() < 0.8
            x, y, z = (self._random.choice(COORDINATES[: 3 if finite else None]) for _ in range(3))
            moves.append((self._path(), (x, y, z, 1.0, self._random.uniform(-1, 1), 0.5, -0.5)))
            edit.set_pose(*moves[-1])
        return tuple(moves)

    def _matrix(self, edit: TreeEdit) -> tuple[Any, ...]:
        path = self._path()
        edit.set_matrix(path, tf.scaling(2, 1, -1))
        return (path,)

    def _visible(self, edit: TreeEdit) -> tuple[Any, ...]:
        path, visible = self._path(), self._random.random() < 0.6
        edit.set_visible(path, visible)
        return path, visible

    def _opacity(self, edit: TreeEdit) -> tuple[Any, ...]:
        path, opacity = self._path(), self._random.choice((1.0, 1.0, 0.5, 0.25, 0.0))
        edit.set_opacity(path, opacity)
        return path, opacity

    def _delete(self, edit: TreeEdit) -> tuple[Any, ...]:
        path = self._path()
        edit.delete(path)
        return (path,)

    def _share(self, edit: TreeEdit) -> tuple[Any, ...]:
        """Put a subtree at a second place, unless it is large by now."""
        source, destination = self._path(), self._path()
        node = self.live.snapshot.root.find(source)
        if node is not None and destination and node.node_count < 40:
            edit.set_subtree(destination, node)
        return source, destination


@pytest.mark.parametrize("seed", range(24))
def test_incremental_flattening_equals_the_definition(seed: int) -> None:
    edits, labels = RandomEdits(seed), LabelTable()
    flattener = Flattener(labels)
    log: list[str] = []
    for _ in range(40):
        log.append(edits.step())
        root = edits.live.snapshot.root
        expected, expected_lights = naive(root, labels)
        try:
            assert_draws(flattener.flatten(edits.live.snapshot), expected)
            assert_draws(flatten(root, label_of=lambda path, _: labels.label_of(path)), expected)
            lights = flattener.flatten(edits.live.snapshot).lights
            for light, values in zip(lights, expected_lights, strict=True):
                np.testing.assert_allclose((*light.position, *light.direction), values, rtol=1e-9, atol=1e-9)
        except AssertionError as error:
            error.add_note("after\n" + "\n".join(log[-8:]))
            raise


def scene(count: int) -> LiveTree:
    live = LiveTree()
    with live.edit() as edit:
        for index in range(count):
            edit.set_parts(("group", index), (SHAPES[0],))
    return live


def test_unchanged_instances_are_the_same_objects() -> None:
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


def test_without_labels_everything_is_unlabelled() -> None:
    assert {i.label for i in flatten(scene(2).snapshot.root).instances} == {LABEL_NONE}


def test_an_error_does_not_leave_half_a_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    live = scene(2)
    flattener = Flattener(LabelTable())
    flattener.flatten(live.snapshot)
    with live.edit() as edit:
        edit.set_pose(("group", 0), (5, 0, 0, 1, 0, 0, 0))
        edit.set_parts(("group", 1), (SHAPES[1],))

    def broken(*_: object) -> Any:
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr("gateway.scene.draw.flatten.meshes_of", broken)
        with pytest.raises(MemoryError):
            flattener.flatten(live.snapshot)
    assert_draws(flattener.flatten(live.snapshot), _again(live))


def _again(live: LiveTree) -> list[tuple[Any, ...]]:
    labels = LabelTable()
    Flattener(labels).flatten(live.snapshot)
    return naive(live.snapshot.root, labels)[0]


def test_a_chain_of_thousands_of_nodes() -> None:
    edit = TreeEdit(Node())
    path: Path = ()
    for index in range(3000):
        path = (*path, index)
    edit.set_parts(path, (SHAPES[0],))
    for depth in (1, 1500, 3000):
        edit.set_pose(path[:depth], (1, 0, 0, 1, 0, 0, 0))
    (instance,) = flatten(edit.commit()).instances
    assert instance.X_world_mesh[0, 3] == 3.0


def test_labels_are_dense_bounded_and_thread_safe() -> None:
    table = LabelTable(limit=100)
    with ThreadPoolExecutor(4) as pool:
        rounds = list(pool.map(lambda _: [table.label_of((k,)) for k in range(150)], range(8)))
    given = {path: label for label, path in table.paths_by_label().items()}
    assert sorted(given.values()) == list(range(1, 101))
    for labels in rounds:
        for k, label in enumerate(labels):
            assert label == given.get((k,), LABEL_NONE)
    assert table.path_of(given[(3,)]) == (3,)
    assert table.path_of(0) is None
    assert table.path_of(101) is None
    assert table.path_of(LABEL_NONE) is None


@pytest.mark.parametrize("limit", [0, -1, MAX_LABELS + 1])
def test_the_label_limit_has_24_bits(limit: Any) -> None:
    with pytest.raises(ValueError, match="label limit"):
        LabelTable(limit)


def test_lights_beyond_the_limit_are_left_out_with_a_warning() -> None:
    live, flattener = LiveTree(), Flattener(LabelTable())
    lamp = (Part(Light(LightKind.POINT), RED),)
    for count, warns in ((MAX_LIGHTS, False), (MAX_LIGHTS + 1, True)):
        with live.edit() as edit:
            for k in range(count):
                edit.set_parts((k,), lamp)
                edit.set_matrix((k,), tf.translation(k, 0, 0))
        lights = flattener.flatten(live.snapshot).lights
        assert [light.position[0] for light in lights] == [*range(MAX_LIGHTS)]
        assert bool(flattener.warning()) == warns
