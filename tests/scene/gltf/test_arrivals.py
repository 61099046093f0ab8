from __future__ import annotations

import hashlib
import itertools
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.scene.gltf import Arrival, MeshCache, read_gltf
from gateway.scene.gltf.bytewise import common_length, equal_at
from gateway.scene.gltf.prefixes import HEAD
from tests.scene.gltf.test_prefixes import document, dump, moved, outcome


def material(source: dict[str, Any], roughness: float) -> dict[str, Any]:
    """As pictures of another kind have it."""
    source["materials"] = [{"pbrMetallicRoughness": {"roughnessFactor": roughness}}]
    source["meshes"][0]["primitives"][0]["material"] = 0
    return dict(sorted(source.items()))


def arrived(data: bytes, cache: MeshCache, step: int) -> Arrival:
    arrival = Arrival(cache.prefixes)
    for begin in range(0, len(data), step):
        arrival.feed(data[begin : begin + step])
    return arrival


@pytest.fixture(scope="module")
def cache() -> MeshCache:
    """Knows three kinds of one scene, the second best known."""
    cache = MeshCache()
    for x, roughness in itertools.product((1, 2, 3), (0.25, 0.75, 0.5)):
        read_gltf(dump(moved(material(document(), roughness), x)), cache=cache)
    assert cache.stats.document_hits == 3
    return cache


@pytest.mark.parametrize("step", [1 << 20, 4096, 100])
@pytest.mark.parametrize("roughness", [0.25, 0.5, 0.75])
def test_what_came_before_is_neither_copied_nor_read(cache: MeshCache, step: int, roughness: float) -> None:
    data = dump(moved(material(document(), roughness), 7))
    arrival = arrived(data, cache, step)
    text = arrival.text()
    assert text.known is not None
    assert len(text.rest) == len(data) - len(text.known.text) < 2000
    assert arrival.sha256() == hashlib.sha256(data).hexdigest()
    before = cache.stats.document_hits
    assert outcome(read_gltf(text, cache=cache)) == outcome(read_gltf(data))
    assert cache.stats.document_hits == before + 1


def test_a_kind_that_is_not_known_shares_what_it_can(cache: MeshCache) -> None:
    data = dump(moved(material(document(), 0.6), 7))
    arrival = arrived(data, cache, 4096)
    text = arrival.text()
    assert text.known is None
    assert len(text.rest) < len(data) / 4
    assert bytes(text) == data
    assert arrival.sha256() == hashlib.sha256(data).hexdigest()
    assert outcome(read_gltf(text, cache=MeshCache())) == outcome(read_gltf(data))


def test_the_text_of_another_cache_is_read_as_a_whole(cache: MeshCache) -> None:
    data = dump(moved(material(document(), 0.5), 7))
    text = arrived(data, cache, 4096).text()
    assert text.known is not None
    assert outcome(read_gltf(text)) == outcome(read_gltf(data))


@given(data=st.data())
@settings(deadline=None, max_examples=60)
def test_bytes_and_hash_never_depend_on_what_is_known(data: st.DataObject, cache: MeshCache) -> None:
    """Cut short, changed somewhere, longer, in pieces of any size."""
    sent = bytearray(dump(moved(material(document(), data.draw(st.sampled_from([0.25, 0.5, 0.75]))), 7)))
    end = data.draw(st.integers(0, len(sent)))
    if data.draw(st.booleans()):
        del sent[end:]
    if sent and data.draw(st.booleans()):
        sent[data.draw(st.integers(0, len(sent) - 1))] ^= 1
    sent += data.draw(st.binary(max_size=300))
    arrival = Arrival(cache.prefixes)
    at = 0
    steps = data.draw(st.lists(st.sampled_from([1, HEAD - 1, HEAD, 5000, 20_000]), min_size=1, max_size=4))
    for step in itertools.cycle(steps):
        arrival.feed(bytes(sent[at : at + step]))
        at += step
        if at >= len(sent):
            break
    text = arrival.text()
    assert bytes(text) == sent
    assert len(text) == len(sent)
    assert arrival.sha256() == hashlib.sha256(sent).hexdigest()


def test_hashes_of_long_texts_go_on_from_their_middle() -> None:
    cache = MeshCache()
    source = document(vertices=150_000)  # several MB
    for x in (1, 2):
        read_gltf(dump(moved(source, x)), cache=cache)
    data = dump(moved(source, 3))
    assert len(data) > 3 << 20
    for changed in (len(data) // 2, (2 << 20) + 1, (2 << 20) - 1, 2 << 20):
        sent = bytearray(data)
        sent[changed] ^= 1
        arrival = arrived(bytes(sent), cache, 1 << 18)
        assert bytes(arrival.text()) == sent
        assert arrival.sha256() == hashlib.sha256(sent).hexdigest()


def test_nothing_is_nothing() -> None:
    arrival = Arrival(MeshCache().prefixes)
    assert len(arrival.text()) == 0
    assert arrival.sha256() == hashlib.sha256().hexdigest()


@given(st.binary(max_size=20_000), st.integers(0, 20_000), st.booleans())
@settings(deadline=None)
def test_comparing_in_the_middle(text: bytes, at: int, same: bool) -> None:
    text *= 3
    begin = min(at, len(text))
    piece = bytearray(text[begin : begin + 12_000])
    if piece and not same:
        piece[at % len(piece)] ^= 128
    expected = bytes(piece) == text[begin : begin + len(piece)]
    assert equal_at(text, begin, memoryview(piece).toreadonly()) is expected
    other = text[:begin] + bytes(piece)
    assert common_length(text, other) == len(beginning(text, other))


def beginning(a: bytes, b: bytes) -> bytes:
    pairs = itertools.takewhile(lambda pair: pair[0] == pair[1], zip(a, b, strict=False))
    return bytes(x for x, _ in pairs)
