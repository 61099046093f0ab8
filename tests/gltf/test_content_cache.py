from __future__ import annotations

import threading

import numpy as np
import pytest

from gateway.gltf import GltfError, GltfLimits, MeshCache, read_gltf
from gateway.gltf.compare import equal_bytes
from gateway.gltf.content_cache import Buffer, mesh_bytes
from renderers.contents import quick_key
from tests.gltf.builder import Builder, meshes


def scene(seed: int = 0, vertices: int = 300) -> bytes:
    b = Builder()
    rng = np.random.default_rng(seed)
    p = b.accessor(rng.random((vertices, 3)))
    b.node(mesh=b.mesh({"attributes": {"POSITION": p}, "indices": b.accessor(np.arange(vertices), "I")}))
    return b.text()


def test_the_same_mesh_across_documents() -> None:
    cache = MeshCache(max_document_bytes=0)
    (first,), (second,) = meshes(read_gltf(scene(), cache=cache)), meshes(read_gltf(scene(), cache=cache))
    (other,) = meshes(read_gltf(scene(1), cache=cache))
    assert first is second
    assert first is not other
    stats = cache.stats
    assert (stats.buffers, stats.meshes) == (3, 2)  # the indices of all are equal
    assert (stats.mesh_hits, stats.mesh_misses) == (1, 2)
    assert stats.buffer_hits == 3


def test_what_is_kept_is_counted_and_bounded_and_the_oldest_goes_first() -> None:
    cache = MeshCache(max_bytes=40_000, max_document_bytes=0)
    one = 300 * (12 + 4)  # positions and indices, which are not copied ...
    normals = 300 * 12  # ... and what was made of them
    (mesh,) = meshes(read_gltf(scene(), cache=cache))
    assert cache.stats.nbytes == one + normals
    assert mesh.positions.base is not None
    for seed in range(1, 20):
        read_gltf(scene(seed), cache=cache)
        assert cache.stats.nbytes <= 40_000
    (again,) = meshes(read_gltf(scene(19), cache=cache))
    assert cache.stats.mesh_hits == 1
    assert again is not mesh
    read_gltf(scene(0), cache=cache)
    assert cache.stats.mesh_hits == 1


@pytest.mark.parametrize("indexed", [True, False])
def test_limits_count_known_meshes_and_new_ones_together(indexed: bool) -> None:
    def document(*seeds: int) -> bytes:
        b = Builder()
        for seed in seeds:
            primitive: dict[str, object] = {
                "attributes": {"POSITION": b.accessor(np.random.default_rng(seed).random((300, 3)))}
            }
            if indexed:
                primitive["indices"] = b.accessor(np.arange(300), "I")
            b.node(mesh=b.mesh(primitive))
        return b.text()

    for limits in (GltfLimits(max_vertices=599), GltfLimits(max_elements=199), GltfLimits(max_mesh_bytes=22_800)):
        for seen in ((), (1,), (2,)):
            cache = MeshCache()
            for seed in seen:
                read_gltf(document(seed), cache=cache)
            with pytest.raises(GltfError, match=r"meshes\[.\]\.primitives\[0\]: .* max_"):
                read_gltf(document(1, 2), cache=cache, limits=limits)
    enough = GltfLimits(max_vertices=600, max_elements=200)
    cache = MeshCache()
    read_gltf(document(2), cache=cache)
    assert len(meshes(read_gltf(document(1, 2), cache=cache, limits=enough))) == 2


def test_clear() -> None:
    cache = MeshCache()
    read_gltf(scene(), cache=cache)
    cache.clear()
    stats = cache.stats
    assert (stats.nbytes, stats.buffers, stats.meshes) == (0, 0, 0)


def test_equal_checksums_do_not_exchange_contents(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("renderers.contents.isal_zlib.crc32", lambda data, checksum=0: 7)
    cache = MeshCache()
    for seed in (0, 1, 2, 0, 1, 2):
        (mesh,) = meshes(read_gltf(scene(seed), cache=cache))
        expected = np.random.default_rng(seed).random((300, 3)).astype(np.float32)
        assert (mesh.positions == expected).all()
        assert mesh.elements.ravel().tolist() == list(range(300))


def test_buffers_that_differ_where_nobody_looks_first_are_both_kept() -> None:
    one = np.random.default_rng(0).bytes(100_000)
    other = one[:5000] + bytes((one[5000] ^ 1,)) + one[5001:]
    assert quick_key(one) == quick_key(other)
    cache = MeshCache()
    first, second = cache.buffer(one), cache.buffer(other)
    assert (first.data, second.data) == (one, other)
    held: dict[int, Buffer] = {}
    assert [cache.buffer(data, held) for data in (other, one, other, one)] == [second, first, second, first]
    assert cache.stats.buffers == 2
    assert [cache.buffer(data) for data in (one, other)] == [first, second]


@pytest.mark.parametrize("size", [0, 1, 1000, 8191, 8192, 8193, 3 * 4096, (1 << 21) + 5])
def test_every_byte_is_compared(size: int) -> None:
    data = np.random.default_rng(size).bytes(size)
    for offset in range(3):
        assert equal_bytes(data, memoryview(bytearray(b"x" * offset + data))[offset:])
    for at in {0, size // 2, size - 1} - {-1} if size else ():
        changed = bytearray(data)
        changed[at] ^= 0x10
        assert not equal_bytes(data, bytes(changed))
        assert not equal_bytes(data, memoryview(changed))
    assert not equal_bytes(data, data + b"x")


def test_meshes_that_two_buffers_make_go_with_either() -> None:
    cache = MeshCache()
    read_gltf(scene(), cache=cache)
    before = cache.stats.nbytes
    cache.max_bytes = before - 1
    cache.buffer(b"x")
    stats = cache.stats
    assert stats.meshes == 0
    assert stats.nbytes == 300 * 4 + 1  # the positions went, and with them the mesh and its normals


def test_bytes_of_a_mesh() -> None:
    cache = MeshCache()
    (mesh,) = meshes(read_gltf(scene(), cache=cache))
    assert mesh_bytes(mesh, []) == mesh.nbytes == 300 * (12 + 4 + 12)


def test_threads_agree_on_one_object() -> None:
    cache = MeshCache()
    texts = [scene(seed, 30) for seed in range(5)]
    results: list[list[int]] = []
    barrier = threading.Barrier(8)

    def work() -> None:
        barrier.wait()
        found = [meshes(read_gltf(text, cache=cache))[0] for _ in range(5) for text in texts]
        results.append([id(mesh) for mesh in found])
        keep.extend(found)

    keep: list[object] = []
    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 8
    assert len({i for ids in results for i in ids}) == 5
