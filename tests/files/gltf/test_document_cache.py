import hashlib
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.files.gltf import GltfCache, GltfError, GltfLimits, GltfScene, read_gltf
from gateway.files.gltf.document_cache import MIN_BYTES, HashedDocument
from renderers.cache import CacheBudget
from tests.files.gltf.builder import Builder, glb, mesh_of, parts


def document(*, seed: int = 0, vertices: int = 600) -> dict[str, Any]:
    """Members sorted by name, as Drake's client writes them."""
    b = Builder("VTK")
    for i in range(3):
        b.draw(np.random.default_rng(seed + i).random((vertices, 3)))
        b.json["nodes"][i] |= {"name": f"g{i}", "matrix": np.eye(4).ravel().tolist()}
    b.add("cameras", {"perspective": {"yfov": 1, "znear": 0.1}})
    b.node(name="Camera Node", camera=0)
    b.node(name="Renderer Node", children=[0, 1, 3])
    b.json.update(scene=0, scenes=[{"nodes": [4]}], samplers=[{}], textures=[])
    return dict(sorted(b.json.items()))


def moved(source: dict[str, Any], x: float) -> dict[str, Any]:
    """The same with other poses."""
    copy: dict[str, Any] = json.loads(json.dumps(source))
    copy["nodes"][0]["matrix"][12] = x
    copy["nodes"][3]["translation"] = [x, 0, 1]
    return copy


def dump(source: dict[str, Any]) -> bytes:
    return json.dumps(source).encode()


def look_up(data: bytes | bytearray) -> HashedDocument:
    return GltfCache().look_up(data, GltfLimits())


def outcome(scene: GltfScene) -> list[Any]:
    nodes = [(path, node.matrix.tolist(), node.parts is None) for path, node in scene.root.walk()]
    arrays = [(path, mesh_of(p).positions.tobytes(), mesh_of(p).elements.tobytes()) for path, p in parts(scene)]
    cameras = [(c.index, c.name, c.X_world_camera.tolist(), c.yfov) for c in scene.cameras]
    counted = (scene.instance_count, scene.element_count)
    return [nodes, arrays, cameras, counted, scene.warnings, scene.generator]


def warm(source: dict[str, Any]) -> GltfCache:
    """A cache that has read the document once."""
    cache = GltfCache()
    read_gltf(dump(moved(source, 1)), cache=cache)
    assert cache.documents.hits == 0
    return cache


def assert_equal_to_uncached(source: dict[str, Any] | bytes, cache: GltfCache) -> GltfScene:
    data = dump(source) if isinstance(source, dict) else source
    scene = read_gltf(data, cache=cache)
    assert outcome(scene) == outcome(read_gltf(data))
    return scene


def test_moved_documents_are_hits() -> None:
    cache = warm(document())
    first, second = (parts(assert_equal_to_uncached(moved(document(), x), cache)) for x in (3.0, 4.0))
    assert all(a[1] is b[1] for a, b in zip(first, second, strict=True))
    assert cache.documents.hits == 2
    assert cache.documents.nbytes > len(dump(document()))
    read_gltf(memoryview(dump(document())), cache=cache)
    assert cache.documents.hits == 3


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["meshes"][0]["primitives"][0].update(mode=0),
        lambda d: d["samplers"].append({"magFilter": 9728}),
        lambda d: d["asset"].update(generator="other"),
        lambda d: d.update(textures=[{"source": None}]),
        lambda d: d.update(zzz=[1]),
        lambda d: d.update(scenes=[{"nodes": [4]}, {"nodes": [2]}], scene=1),
        lambda d: d["nodes"].append({"mesh": 2}),
        lambda d: d["nodes"][4].update(children=[2, 3]),  # a mesh that was not used before
        lambda d: d["nodes"][0].update(mesh=7),
        lambda d: d["nodes"][0].update(camera=7),
        lambda d: d["nodes"][0].update(matrix=[1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]),
    ],
)
def test_any_other_difference_gives_the_uncached_result(change: Any) -> None:
    cache = warm(document())
    other = moved(document(), 3)
    change(other)
    assert_equal_to_uncached(other, cache)


@pytest.mark.parametrize(
    "node",
    [{"children": [0]}, {"matrix": [1]}, {"name": 7}, {"scale": "x"}, {"matrix": None, "rotation": [0, 0, 0, 0]}],
)
def test_warnings_about_nodes_are_those_of_each_document(node: dict[str, Any]) -> None:
    flawed = moved(document(), 3)
    flawed["nodes"][0].update(node)
    for documents in ((document(), flawed, document()), (flawed, flawed, document(), flawed)):
        cache = GltfCache()
        for source in documents:
            scene = assert_equal_to_uncached(source, cache)
            assert len(scene.warnings) == (source is flawed)


def test_one_different_bit_of_a_buffer_is_a_miss() -> None:
    cache = warm(document())
    data = bytearray(dump(moved(document(), 3)))
    at = data.rindex(b"base64,", 0, data.index(b'"nodes"')) + 4000
    data[at] = ord("B") if data[at] != ord("B") else ord("C")
    assert_equal_to_uncached(bytes(data), cache)
    assert cache.documents.hits == 0


def test_limits_are_part_of_the_key() -> None:
    cache = warm(document())
    with pytest.raises(GltfError, match="max_vertices = 10"):
        read_gltf(dump(moved(document(), 3)), cache=cache, limits=GltfLimits(max_vertices=10))
    assert cache.documents.hits == 0
    read_gltf(dump(moved(document(), 3)), cache=cache)
    assert cache.documents.hits == 1


def test_color_depth_and_label_documents_are_kept_side_by_side() -> None:
    """Colour, depth and label requests of one scene: equal buffers, other materials."""
    cache = GltfCache()

    def kind(roughness: float) -> dict[str, Any]:
        source = document()
        source["materials"] = [{"pbrMetallicRoughness": {"roughnessFactor": roughness}}]
        source["meshes"][0]["primitives"][0]["material"] = 0
        return dict(sorted(source.items()))

    for x in range(6):
        for roughness in (0.25, 0.5, 0.75):
            scene = read_gltf(dump(moved(kind(roughness), x)), cache=cache)
            assert parts(scene)[0][1].material.roughness == roughness
    assert cache.documents.hits == 5 * 3


def test_least_recently_used_documents_are_dropped() -> None:
    size = len(dump(document()))
    budget = CacheBudget(12 * size)
    cache = GltfCache(budget)
    for seed in range(0, 300, 10):
        read_gltf(dump(moved(document(seed=seed), 1)), cache=cache)
        assert sum(each.nbytes for each in budget.figures().values()) <= 12 * size
    read_gltf(dump(moved(document(seed=290), 3)), cache=cache)
    assert cache.documents.hits == 1
    read_gltf(dump(moved(document(seed=0), 3)), cache=cache)
    assert cache.documents.hits == 1


def test_small_and_binary_documents_are_not_kept() -> None:
    cache = GltfCache()
    small = dump(document(vertices=3))
    assert len(small) < MIN_BYTES
    for data in (small, glb(dump(document()))):
        for _ in range(4):
            read_gltf(data, cache=cache)
    assert cache.documents.nbytes == 0


def test_the_last_list_of_nodes_is_found() -> None:
    source = document()
    source["meshes"][0]["name"] = '"nodes":[{}],"x"'
    source["scenes"] = [{"nodes": [4], "name": '"nodes"'}, {"nodes": []}]
    data = dump(source)
    hashed = look_up(data)
    assert data[hashed.nodes_offset :].startswith(b'"nodes": [{"mesh": 0, "name": "g0"')
    assert hashed.digest == hashlib.sha256(data).hexdigest()


def test_text_is_not_split_before_data_uris() -> None:
    source = document()
    source["zzz"] = source.pop("buffers")
    data = dump(source)
    assert data.index(b'"nodes"') < data.index(b'"data:')
    hashed = look_up(data)
    assert hashed.nodes_offset == 0
    assert hashed.digest == hashlib.sha256(data).hexdigest()


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["scenes"][0].update(extras={"nodes": [{}]}),
        lambda d: d.update(zzz={"nodes": [{"mesh": 0}]}),
        lambda d: d["textures"].append({"name": '"nodes":[{"mesh":0}'}),
    ],
)
def test_other_lists_named_nodes_do_not_change_the_result(change: Any) -> None:
    cache, source = GltfCache(), document()
    change(source)
    for x in range(3):
        assert_equal_to_uncached(moved(source, x), cache)


@given(st.data())
@settings(deadline=None, max_examples=60)
def test_the_result_does_not_depend_on_the_cache(data: st.DataObject) -> None:
    """Members in any order, other poses each time."""
    source = document()
    names = data.draw(st.permutations(list(source)))
    cache = GltfCache()
    for x in range(4):
        poses = moved({name: source[name] for name in names}, x)
        text = json.dumps(poses, indent=data.draw(st.sampled_from([None, 1])))
        assert_equal_to_uncached(text.encode(), cache)


@pytest.mark.parametrize(
    ("limit", "value", "node_count"),
    [
        ("max_json_bytes", 30_000, 20_000),
        ("max_json_bytes", 30_000, 4_000),
        ("max_json_values", 15_000, 20_000),
        ("max_json_values", 15_000, 6_000),
    ],
)
def test_hits_are_limited_as_whole_documents_are(limit: str, value: int, node_count: int) -> None:
    """The text from the nodes on is beyond the limit alone, or only together with the text before the nodes."""
    before = {"extras": [0] * 9_500} if limit == "max_json_values" else {"extras": "x" * 20_000}
    small, large = dump({**before, **moved(document(), 1)}), {**before, **moved(document(), 2)}
    large["nodes"] += [{} for _ in range(node_count)]
    limits, cache = GltfLimits(**{limit: value}), GltfCache()
    for _ in range(2):
        read_gltf(small, cache=cache, limits=limits)
    assert cache.documents.hits == 1
    messages = []
    for used_cache in (None, cache):
        with pytest.raises(GltfError, match=rf"{limit} = {value}") as caught:
            read_gltf(dump(large), cache=used_cache, limits=limits)
        messages.append(str(caught.value))
    assert messages[0] == messages[1]


def test_a_cached_part_does_not_allow_deeper_nesting() -> None:
    def is_read(depth: int, cache: GltfCache | None) -> bool:
        source = moved(document(), 2)
        source["nodes"][0]["extras"] = "NESTED"
        text = dump(source).replace(b'"NESTED"', b"[" * depth + b"]" * depth)
        try:
            read_gltf(text, cache=cache)
        except GltfError as error:
            assert "nested too deeply" in str(error)
            return False
        return True

    deepest, refused = 1, 200_000
    while refused - deepest > 1:
        depth = (deepest + refused) // 2
        deepest, refused = (depth, refused) if is_read(depth, None) else (deepest, depth)
    cache = warm(document())
    assert is_read(deepest, cache)
    assert not is_read(refused, cache)


@pytest.mark.parametrize(("size", "expected"), [(MIN_BYTES - 1, 0), (MIN_BYTES, MIN_BYTES)])
def test_texts_of_the_least_size_before_the_nodes_are_kept(size: int, expected: int) -> None:
    before = b'{"extras":"'.ljust(size - 2, b"x") + b'",'
    assert look_up(before + b'"nodes":[{}]}').nodes_offset == expected


def test_64_occurrences_of_nodes_are_searched() -> None:
    before = b'{"extras":"'.ljust(MIN_BYTES, b"x") + b'","nodes":[{}],'
    for others, found in ((63, True), (64, False)):
        scenes = ",".join(['{"nodes":[0]}'] * others).encode()
        hashed = look_up(before + b'"scenes":[' + scenes + b"]}")
        assert (hashed.nodes_offset > 0) == found


def test_digests_are_those_of_all_bytes_whatever_is_known() -> None:
    cache = warm(document())
    for x in (2.0, 2.0, 3.0):
        data = dump(moved(document(), x))
        hashed = cache.look_up(bytearray(data), GltfLimits())
        assert hashed.known is not None
        assert hashed.digest == hashed.digest == hashlib.sha256(data).hexdigest()
        read_gltf(hashed, cache=cache)


def test_text_with_the_checksum_of_another_is_not_taken_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """A client can choose text so that the checksums are equal."""
    monkeypatch.setattr("isal.isal_zlib.crc32", lambda text: 1)
    cache, sizes = GltfCache(), set()
    for seed in (0, 1, 0):
        data = dump(document(seed=seed))
        assert_equal_to_uncached(data, cache)
        sizes.add(cache.look_up(data, GltfLimits()).nodes_offset)
        assert cache.look_up(data, GltfLimits()).digest == hashlib.sha256(data).hexdigest()
    assert len(sizes) == 1


def test_elements_and_instances_are_counted_again_for_moved_documents() -> None:
    cache = GltfCache()
    first = read_gltf(dump(moved(document(), 1)), cache=cache)
    other = moved(document(), 2)
    other["nodes"].append({"mesh": 0})
    other["nodes"][4]["children"].append(5)
    second = read_gltf(dump(other), cache=cache)
    assert cache.documents.hits == 1
    assert (first.instance_count, first.element_count) == (2, 400)
    assert (second.instance_count, second.element_count) == (3, 600)
    for limit, value in (("max_drawn_elements", 599), ("max_instances", 2)):
        limits = GltfLimits(**{limit: value})
        read_gltf(dump(moved(document(), 1)), cache=cache, limits=limits)
        hits = cache.documents.hits
        read_gltf(dump(moved(document(), 2)), cache=cache, limits=limits)
        assert cache.documents.hits == hits + 1
        with pytest.raises(GltfError, match=f"{limit} = {value}"):
            read_gltf(dump(other), cache=cache, limits=limits)
