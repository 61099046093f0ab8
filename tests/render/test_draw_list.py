from __future__ import annotations

import gc
import json
import weakref
from typing import Any

import numpy as np
import pytest

from gateway.gltf import MeshCache, read_gltf
from gateway.render.draw_list import Companies
from gateway.render.labels import labels_of
from gateway.scene.flatten import flatten
from tests.gltf.builder import Builder
from tests.support.corpus import drake_scenes


def assert_same(data: bytes) -> None:
    """The draw list is the one that the tree gives."""
    scene = read_gltf(data)
    fast, slow = Companies().drawn(scene)[0], flatten(scene.root, label_of=labels_of(scene.root))
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
    labels = [instance.label for instance in Companies().drawn(read_gltf(data))[0].instances]
    assert labels[:3] == [5 + 256, 5 + 256, 5 + 256]
    assert labels[3:] == [0xFFFFFF, 7] + 8 * [0xFFFFFF]


def shifted(data: bytes, x: float) -> bytes:
    document = json.loads(data)
    for node in document["nodes"]:
        node["matrix"] = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, 0, 0, 1]
    document["asset"]["extras"] = "short texts are not remembered" * 200
    return json.dumps(document, sort_keys=True).encode()


def two_triangles(red: float = 1.0) -> bytes:
    b = Builder()
    material = b.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [red, 0, 0, 1]}})
    b.node(mesh=b.triangle(material=material))
    b.node(mesh=b.triangle())
    return b.text()


def test_a_company_is_known_again_wherever_it_stands_and_while_it_is_kept() -> None:
    cache, companies = MeshCache(1 << 20), Companies()
    data = two_triangles()
    scenes = [read_gltf(shifted(data, x), cache=cache) for x in (0.0, 0.0, 1.0, 2.0)]
    lists, kept = zip(*[companies.drawn(scene) for scene in scenes], strict=True)
    assert [listed.instances[1].X_world_mesh[0, 3] for listed in lists] == [0.0, 0.0, 1.0, 2.0]
    assert kept[2] is kept[3]
    for scene, listed in zip(scenes, lists, strict=True):
        fresh = Companies().drawn(scene)[0]
        assert listed.images == fresh.images
        for a, b in zip(listed.instances, fresh.instances, strict=True):
            assert (a.mesh, a.material, a.label, a.instance_id) == (b.mesh, b.material, b.label, b.instance_id)
            assert (a.X_world_mesh == b.X_world_mesh).all()
    far, smaller = companies.drawn(read_gltf(shifted(data, 1e30), cache=cache))
    assert len(far.instances) == 0
    assert smaller not in kept
    gone = weakref.ref(kept[-1])
    del kept, lists, smaller, far
    gc.collect()
    assert gone() is None
    other = companies.drawn(read_gltf(two_triangles(0.5), cache=cache))[0]
    assert other.instances[0].material.base_color[0] == 0.5


def test_what_moves_all_the_time_is_known_however_many_others_come() -> None:
    cache, companies = MeshCache(1 << 20), Companies()
    robot = [read_gltf(shifted(two_triangles(), x), cache=cache) for x in (0.0, 0.0, 1.0)][-1]
    kept = [companies.drawn(robot)[1]]
    for number in range(20):
        kept.append(companies.drawn(read_gltf(two_triangles(number / 20), cache=cache))[1])
        assert companies.drawn(robot)[1] is kept[0]
    assert len({id(company) for company in kept}) == len(kept)
