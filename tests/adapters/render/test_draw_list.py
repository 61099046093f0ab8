import json
from typing import Any

import pytest

from gateway.adapters.render.labels import labels_of
from gateway.adapters.render.scenes import SceneTopology, TopologyKey, draw_list_of
from gateway.files.gltf import DRAKE_MERGER, GltfCache, GltfScene, read_gltf
from gateway.scene.draw.flatten import flatten
from renderers.cache import Cache, CacheBudget
from renderers.drawlist import DrawList, Instance, PosedInstances
from renderers.shading.materials import look_material
from tests.files.gltf.builder import Builder
from tests.support.corpus import drake_scenes


def fresh() -> Cache[TopologyKey, SceneTopology]:
    return Cache("topologies", budget=CacheBudget(1 << 30))


def drawn(scene: GltfScene) -> DrawList:
    return draw_list_of(scene, fresh())


def assert_same(data: bytes) -> None:
    """The draw list is the one that the tree gives, in any order if Drake merged it."""
    scene = read_gltf(data)
    fast, slow = drawn(scene), flatten(scene.root, label_of=labels_of(scene.root))

    def key(instance: Instance) -> tuple[object, ...]:
        return id(instance.mesh), id(instance.material), instance.label, (instance.X_world_mesh + 0.0).tobytes()

    keys = [list(map(key, each.instances)) for each in (fast, slow)]
    if scene.generator == DRAKE_MERGER:
        assert sorted(keys[0]) == sorted(keys[1])
        assert set(fast.images) == set(slow.images)
    else:
        assert keys[0] == keys[1]
        assert fast.images == slow.images
    assert [instance.instance_id for instance in fast.instances] == list(range(len(fast.instances)))


def test_merged_files_come_first_and_backwards() -> None:
    """As RenderEngineVtk draws them: its own nodes in order, files and their nodes last child first."""
    b = Builder(DRAKE_MERGER)
    mesh = b.triangle()

    def place(x: float, **fields: Any) -> int:
        return b.node(mesh=mesh, matrix=[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, 0, 0, 1], **fields)

    exported = b.node(children=[place(1), place(2)])
    first = place(3, children=[place(0.5), place(0.25)])
    second = place(4)
    b.json["scenes"] = [{"nodes": [exported, first, second]}]
    xs = [instance.X_world_mesh[0, 3] for instance in drawn(read_gltf(b.text())).instances]
    assert xs == [4, 3, 3.25, 3.5, 1, 2]


def test_primitives_without_material_are_lit_as_by_render_engine_vtk() -> None:
    """Physically in the first glTF file, and with Lambert's law in the others, whatever the order of drawing."""
    b = Builder(DRAKE_MERGER)
    bare, named = b.triangle(), b.triangle(material=b.add("materials", {}))
    exported = b.node(mesh=named)
    first, second = b.node(mesh=bare), b.node(children=[b.node(mesh=bare)])
    b.json["scenes"] = [{"nodes": [exported, first, second]}]
    materials = [instance.material for instance in drawn(read_gltf(b.text())).instances]
    seen = [look_material(material, "pbr") for material in materials]
    assert [(each.lambert, each.double_sided) for each in seen] == [(True, True), (False, True), (False, False)]
    assert (seen[1].metallic, seen[1].roughness) == (0.0, 0.5)
    assert [look_material(material, "gltf").lambert for material in materials] == [False, False, False]


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


def test_moved_scenes_share_their_instance_set() -> None:
    cache, topologies = GltfCache(CacheBudget(1 << 20)), fresh()
    data = two_triangles()
    scenes = [read_gltf(shifted(data, x), cache=cache) for x in (0.0, 1.0, 2.0)]
    lists = [draw_list_of(scene, topologies) for scene in scenes]
    assert [listed.instances[1].X_world_mesh[0, 3] for listed in lists] == [0.0, 1.0, 2.0]
    assert len({id(instance_set(listed)) for listed in lists}) == 1
    for scene, listed in zip(scenes, lists, strict=True):
        expected = drawn(scene)
        assert listed.images == expected.images
        for a, b in zip(listed.instances, expected.instances, strict=True):
            assert (a.mesh, a.material, a.label, a.instance_id) == (b.mesh, b.material, b.label, b.instance_id)
            assert (a.X_world_mesh == b.X_world_mesh).all()


def test_scenes_with_another_topology_or_content_share_nothing() -> None:
    cache, topologies = GltfCache(CacheBudget(1 << 20)), fresh()
    near = draw_list_of(read_gltf(shifted(two_triangles(), 1.0), cache=cache), topologies)
    far = draw_list_of(read_gltf(shifted(two_triangles(), 1e30), cache=cache), topologies)
    other = draw_list_of(read_gltf(shifted(two_triangles(0.5), 1.0), cache=cache), topologies)
    document = json.loads(shifted(two_triangles(), 1.0))
    document["nodes"][0]["children"] = [1]
    below = draw_list_of(read_gltf(json.dumps(document, sort_keys=True).encode(), cache=cache), topologies)
    assert [len(each.instances) for each in (near, far, other, below)] == [2, 0, 2, 2]
    assert other.instances[0].material.base_color[0] == 0.5
    assert below.instances[1].X_world_mesh[0, 3] == 2.0
    assert len({id(instance_set(each)) for each in (near, far, other, below)}) == 4


def instance_set(listed: DrawList) -> object:
    assert isinstance(listed.instances, PosedInstances)
    return listed.instances.set


@pytest.mark.parametrize("x", [1e15, -1e15, 1e300])
def test_instances_beyond_the_limit_are_left_out(x: float) -> None:
    data = shifted(two_triangles(), x)
    assert len(drawn(read_gltf(data)).instances) == 0
    assert len(drawn(read_gltf(shifted(two_triangles(), 0.999 * x if abs(x) < 1e16 else 0.0))).instances) == 2
