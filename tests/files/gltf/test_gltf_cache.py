"""Meshes and images that documents share through a cache."""

import threading
from functools import partial

import numpy as np
import pytest

from gateway.files.gltf import GltfCache, GltfError, GltfLimits, GltfScene, read_gltf
from renderers.cache import CacheBudget
from renderers.drawlist import Image, Mesh
from tests.files.gltf.builder import Builder, meshes, parts
from tests.files.gltf.test_material_reader import png, with_texture


def scene(*seeds: int, vertices: int = 300, indexed: bool = True) -> bytes:
    """A document that draws a mesh for each seed."""
    b = Builder()
    for seed in seeds or (0,):
        b.draw(np.random.default_rng(seed).random((vertices, 3)), np.arange(vertices) if indexed else None)
    return b.text()


def read_parts(data: bytes, cache: GltfCache) -> GltfScene:
    """Read a document without the cache of documents, which is not used for those that may name files."""

    def no_files(uri: str) -> bytes:
        raise AssertionError(uri)

    return read_gltf(data, cache=cache, resolve=no_files)


def test_documents_share_meshes_of_equal_content() -> None:
    cache = GltfCache()
    (first,), (second,) = meshes(read_parts(scene(), cache)), meshes(read_parts(scene(), cache))
    (other,) = meshes(read_parts(scene(1), cache))
    assert first is second
    assert first is not other
    assert (cache.content.hits, cache.content.misses) == (1, 2)
    assert cache.content.nbytes == first.nbytes + other.nbytes


def test_documents_share_images_of_equal_content() -> None:
    def image(shade: int, roughness: float) -> Image:
        b = with_texture(png((shade, shade, shade)))
        pbr = {"baseColorTexture": {"index": 0}, "roughnessFactor": roughness}
        b.draw(material=b.add("materials", {"pbrMetallicRoughness": pbr}))
        ((_, part),) = parts(read_parts(b.text(), cache))
        return part.material.base_color_texture.image

    cache = GltfCache()
    first = image(10, 0.5)
    assert image(10, 0.25) is first
    assert image(11, 0.5) is not first


def test_meshes_own_their_arrays() -> None:
    """A view would keep the whole buffer alive, which is not accounted for."""
    (mesh,) = meshes(read_gltf(scene()))
    for array in (mesh.positions, mesh.elements):
        owner = array if array.base is None else array.base
        assert isinstance(owner, np.ndarray)
        assert owner.base is None
        assert owner.nbytes == array.nbytes


def test_least_recently_used_meshes_are_dropped_beyond_the_limit() -> None:
    size = 300 * (12 + 4)
    cache = GltfCache(CacheBudget(3 * size))
    for seed in range(3):
        read_parts(scene(seed), cache)
    assert cache.content.nbytes == 3 * size
    read_parts(scene(0), cache)
    read_parts(scene(3), cache)  # in place of 1
    hits = cache.content.hits
    read_parts(scene(0), cache)
    assert cache.content.hits == hits + 1
    read_parts(scene(1), cache)
    assert cache.content.hits == hits + 1
    assert cache.content.nbytes == 3 * size


@pytest.mark.parametrize("indexed", [True, False])
def test_limits_count_known_and_new_meshes_together(indexed: bool) -> None:
    document = partial(scene, indexed=indexed)
    exact = 2 * (300 * 72 + 100 * 12)
    for limits in (GltfLimits(max_vertices=599), GltfLimits(max_elements=199), GltfLimits(max_mesh_bytes=exact - 1)):
        for seen in ((), (1,), (2,)):
            cache = GltfCache()
            for seed in seen:
                read_gltf(document(seed), cache=cache)
            with pytest.raises(GltfError, match=r"meshes\[1\]\.primitives\[0\]: .* max_"):
                read_gltf(document(1, 2), cache=cache, limits=limits)
    enough = GltfLimits(max_vertices=600, max_elements=200, max_mesh_bytes=exact)
    cache = GltfCache()
    read_gltf(document(2), cache=cache)
    assert len(meshes(read_gltf(document(1, 2), cache=cache, limits=enough))) == 2


def test_meshes_with_warnings_are_not_shared() -> None:
    b = Builder()
    positions = np.zeros((6, 3))
    positions[5] = np.nan
    b.draw(positions)
    cache = GltfCache()
    first, second = read_parts(b.text(), cache), read_parts(b.text(), cache)
    assert len(first.warnings) == len(second.warnings) == 1
    assert cache.content.nbytes == 0


def test_threads_share_one_cache() -> None:
    cache = GltfCache()
    texts = [scene(seed, vertices=30) for seed in range(5)]
    found: list[tuple[int, Mesh]] = []
    barrier = threading.Barrier(8)

    def work() -> None:
        barrier.wait()
        found.extend((seed, meshes(read_gltf(texts[seed], cache=cache))[0]) for _ in range(5) for seed in range(5))

    threads = [threading.Thread(target=work) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8 * 25
    for seed, mesh in found:
        expected = np.random.default_rng(seed).random((30, 3)).astype(np.float32)
        np.testing.assert_array_equal(mesh.positions, expected)
    assert len(cache.content) == 5
