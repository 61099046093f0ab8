from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from gateway.render.drawn import drawn
from gateway.render.labels import labels_of
from gateway.scene.flatten import flatten
from gateway.scene.gltf import read_gltf
from tests.scene.gltf.builder import Builder
from tests.support.corpus import drake_scenes


def assert_same(data: bytes) -> None:
    """The draw list is the one that the tree gives."""
    scene = read_gltf(data)
    fast, slow = drawn(scene), flatten(scene.root, label_of=labels_of(scene.root))
    assert len(fast.instances) == len(slow.instances)
    for a, b in zip(fast.instances, slow.instances, strict=True):
        assert (a.mesh, a.material, a.label, a.instance_id) == (b.mesh, b.material, b.label, b.instance_id)
        np.testing.assert_array_equal(a.X_world_mesh, b.X_world_mesh)
    assert fast.images == slow.images


@pytest.mark.corpus
@pytest.mark.parametrize("scene", drake_scenes(), ids=str)
@pytest.mark.parametrize("kind", ["color", "label"])
def test_recorded_scenes(scene: Any, kind: str) -> None:
    assert_same(scene.request(kind).scene)


def test_levels_labels_and_what_lies_too_far() -> None:
    b = Builder()
    material = b.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [5 / 255, 1 / 255, 0, 1]}})
    other = b.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [7 / 255, 0, 0, 1]}})
    named = b.triangle(material=material)
    others = b.triangle(material=other)
    bare = b.triangle()
    shift = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1, 2, 3, 1]
    far = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1e30, 0, 0, 1]
    b.node(name="one label", children=[1, 2], matrix=shift)
    b.node(mesh=bare, scale=[2, -1, 1])
    b.node(mesh=named, children=[3], matrix=shift)
    b.node(mesh=bare, rotation=[0, 0, 0.6, 0.8])
    b.node(name="two labels", children=[5, 6, 7])
    b.node(mesh=bare)
    b.node(mesh=named, matrix=far)
    b.node(mesh=others, matrix=shift)
    for _ in range(8):
        b.node(mesh=bare, matrix=shift)
    data = b.text()
    assert_same(data)
    labels = [instance.label for instance in drawn(read_gltf(data)).instances]
    assert labels[:3] == [5 + 256, 5 + 256, 5 + 256]
    assert labels[3:] == [0xFFFFFF, 7] + 8 * [0xFFFFFF]
