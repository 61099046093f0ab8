from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from gateway.scene.gltf import Arrival, GltfError, GltfLimits, MeshCache, read_gltf
from gateway.scene.gltf.prefixes import MIN_LENGTH
from tests.scene.gltf.builder import Builder, data_uri, glb, mesh_of, parts
from tests.scene.gltf.test_materials import png
from tests.scene.gltf.test_prefixes import dump, outcome

LIMITS = GltfLimits()


def document(*, seed: int = 0, vertices: int = 600, generator: str = "VTK") -> dict[str, Any]:
    """Members sorted by name, as Drake's client writes them; with a texture, which comes before the materials."""
    b = Builder(generator)
    for i in range(3):
        p = b.accessor(np.random.default_rng(seed + i).random((vertices, 3)))
        indices = b.accessor(np.arange(vertices), "I")
        b.node(mesh=b.mesh({"attributes": {"POSITION": p}, "indices": indices, "material": i % 2}))
    b.add("images", {"uri": data_uri(png())})
    b.add("textures", {"source": 0})
    b.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}})
    b.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    b.add("cameras", {"perspective": {"yfov": 1, "znear": 0.1}, "name": 'not the "materials"'})
    return dict(sorted(b.json.items()))


def painted(source: dict[str, Any], red: float) -> dict[str, Any]:
    copy: dict[str, Any] = json.loads(json.dumps(source))
    copy["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"][0] = red
    return copy


def colors(scene: Any) -> list[Any]:
    looks = [part.material for _, part in parts(scene)]
    return [(look.base_color, look.base_color_texture and look.base_color_texture.image.key) for look in looks]


def is_grown(cache: MeshCache, data: bytes) -> bool:
    return cache.stems.find(data, LIMITS) is not None


def test_what_comes_before_other_materials_is_taken_over() -> None:
    cache = MeshCache()
    first = read_gltf(dump(document()), cache=cache)
    misses = cache.stats.buffer_misses
    for red in (0.25, 0.5):
        data = dump(painted(document(), red))
        assert is_grown(cache, data)
        scene = read_gltf(data, cache=cache)
        assert outcome(scene) == outcome(read_gltf(data))
        assert colors(scene) == colors(read_gltf(data))
        assert colors(scene)[0][0][0] == red
        for (_, new), (_, old) in zip(parts(scene), parts(first), strict=True):
            assert mesh_of(new) is mesh_of(old)
    stats = cache.stats
    assert (stats.buffer_hits, stats.buffer_misses) == (0, misses)
    assert misses == 5  # three meshes share their indices
    cache.clear()
    assert cache.stats.text_bytes == 0


def test_other_meshes_of_the_same_accessors() -> None:
    cache = MeshCache()
    read_gltf(dump(document()), cache=cache)
    other = document()
    other["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = 2
    other["nodes"].append({"mesh": 1, "translation": [1, 2, 3]})
    data = dump(other)
    assert is_grown(cache, data)
    assert outcome(read_gltf(data, cache=cache)) == outcome(read_gltf(data))


def test_what_arrives_piece_by_piece_is_kept_and_a_view_is_not() -> None:
    for keeps in (True, False):
        cache = MeshCache()
        data = dump(document())
        if keeps:
            arrival = Arrival(cache.prefixes)
            for begin in range(0, len(data), 1000):
                arrival.feed(data[begin : begin + 1000])
            read_gltf(arrival.text(), cache=cache)
        else:
            read_gltf(memoryview(bytearray(data)), cache=cache)
        assert is_grown(cache, dump(painted(document(), 0.5))) == keeps


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["accessors"][0].update(name="another"),
        lambda d: d["buffers"][0].update(byteLength=1),
        lambda d: d["asset"].update(copyright="another"),
        lambda d: d["cameras"][0].update(name="another"),
    ],
)
def test_another_stem_is_read(change: Any) -> None:
    cache = MeshCache()
    read_gltf(dump(document()), cache=cache)
    other = document()
    change(other)
    data = dump(other)
    assert not is_grown(cache, data)
    assert outcome(read_gltf(data, cache=cache)) == outcome(read_gltf(data))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b'"meshes": ', b'"accessors": [], "meshes": '),  # a member that stands twice: the last one counts
        (b'"meshes": ', b'"meshes": [], "meshes": '),
        (b'"meshes": ', b'"extra": NaN, "meshes": '),  # what only the lenient parser reads
        (b'"meshes": [', b'"meshes": ['),
    ],
)
def test_rests_that_have_to_be_read_with_the_whole(old: bytes, new: bytes) -> None:
    cache = MeshCache()
    read_gltf(dump(document()), cache=cache)
    data = dump(painted(document(), 0.5)).replace(old, new, 1)

    def told(**options: Any) -> Any:
        try:
            return outcome(read_gltf(data, **options))
        except GltfError as error:
            return str(error)

    assert told(cache=cache) == told()


def test_a_rest_that_is_broken_is_refused_as_the_whole_is() -> None:
    cache = MeshCache()
    data = dump(document())
    read_gltf(data, cache=cache)
    for broken in (data[:-1], data + b"}", data[:-1] + b",]"):
        assert not is_grown(cache, broken)
        with pytest.raises(GltfError, match="not JSON"):
            read_gltf(broken, cache=cache)


def test_other_limits_are_asked_anew() -> None:
    cache = MeshCache()
    data = dump(document())
    read_gltf(data, cache=cache)
    for limits in (GltfLimits(max_buffer_bytes=10_000), GltfLimits(max_vertices=1000), GltfLimits(max_elements=100)):
        with pytest.raises(GltfError, match="max_"):
            read_gltf(data, cache=cache, limits=limits)
    many = document()
    many["nodes"] += [{"mesh": 0} for _ in range(20)]
    for _ in range(2):
        with pytest.raises(GltfError, match="max_instances = 10"):
            read_gltf(dump(many), cache=cache, limits=GltfLimits(max_instances=10))


def test_faults_of_accessors_are_told_every_time() -> None:
    source = document(generator="Drake glTF merger")
    source["accessors"][0]["sparse"] = {"count": 1, "indices": {"bufferView": 99}, "values": {"bufferView": 99}}
    cache = MeshCache()
    for red in (0.1, 0.2, 0.3):
        scene = read_gltf(dump(painted(source, red)), cache=cache)
        assert [w for w in scene.warnings if "sparse" in w]


def test_small_and_binary_documents_are_not_kept() -> None:
    cache = MeshCache()
    small = dump(document(vertices=3))
    assert len(small) < MIN_LENGTH
    plain = document()
    del plain["materials"]
    for mesh in plain["meshes"]:
        del mesh["primitives"][0]["material"]
    for data in (small, glb(dump(document())), dump(plain)):
        read_gltf(data, cache=cache)
        assert cache.stats.text_bytes == 0


def test_stems_are_bounded_and_the_oldest_goes_first() -> None:
    size = len(dump(document()))
    cache = MeshCache(max_text_bytes=4 * 16 * size)
    for seed in range(0, 300, 10):
        read_gltf(dump(document(seed=seed)), cache=cache)
        assert 0 < cache.stems.nbytes <= cache.stems.max_bytes
    assert is_grown(cache, dump(document(seed=290)))
    assert not is_grown(cache, dump(document(seed=0)))


def test_meshes_that_are_described_in_several_ways_count_once() -> None:
    source = document()
    for at in (0, 1):
        source["accessors"].append(dict(source["accessors"][at]))
    again = {"attributes": {"POSITION": len(source["accessors"]) - 2}, "indices": 1, "material": 0}
    source["meshes"].append({"primitives": [again, {**again, "indices": len(source["accessors"]) - 1}]})
    source["nodes"].append({"mesh": 3})
    cache, limits = MeshCache(), GltfLimits(max_vertices=3 * 600, max_elements=3 * 200)
    expected = outcome(read_gltf(dump(source), limits=limits))
    for red in (0.1, 0.2, 0.3):
        data = dump(painted(source, red))
        assert outcome(read_gltf(data, cache=cache, limits=limits)) == expected
    assert cache.stems.find(data, limits) is not None
    with pytest.raises(GltfError, match="max_vertices = 1799"):
        read_gltf(data, cache=cache, limits=GltfLimits(max_vertices=1799))
