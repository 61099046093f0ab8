"""Documents with members in any order or twice: a cached document never changes another one."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.files.gltf import GltfCache, GltfError, read_gltf
from tests.files.gltf.builder import Builder, mesh_of, meshes, parts
from tests.files.gltf.test_accessors import sparse
from tests.files.gltf.test_document_cache import outcome

NAMES = ("buffers", "bufferViews", "accessors", "materials", "meshes", "nodes", "scenes", "scene")


def document(z: float = 1.0) -> dict[str, Any]:
    """A triangle at a height, drawn by one of two nodes."""
    b = Builder()
    data = np.array([[0, 0, z], [1, 0, z], [0, 1, z]], np.float32).tobytes() + np.arange(3, dtype=np.uint32).tobytes()
    b.json["asset"]["extras"] = "long enough to be kept " * 300
    view = b.view(data)
    b.json["bufferViews"] = [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 12}]
    b.points(view)
    b.points(view + 1, type="SCALAR", componentType=5125)
    b.add("materials", {})
    b.mesh({"attributes": {"POSITION": 0}, "indices": 1, "material": 0})
    return b.json | {"nodes": [{"mesh": 0}, {"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0}


def dump(source: dict[str, Any], order: tuple[str, ...] = NAMES) -> bytes:
    return json.dumps({name: source[name] for name in ("asset", *order)}, separators=(",", ":")).encode()


def drawn(data: bytes, cache: GltfCache | None = None) -> Any:
    scene = read_gltf(data, cache=cache)
    return outcome(scene), [mesh_of(part).positions.tobytes() for _, part in parts(scene)]


@settings(deadline=None, max_examples=60)
@given(st.permutations(NAMES))
def test_members_in_any_order(order: list[str]) -> None:
    cache = GltfCache()
    for z in (1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 1.0):
        data = dump(document(z), tuple(order))
        assert drawn(data, cache) == drawn(data)


def test_buffer_views_after_the_materials() -> None:
    order = ("buffers", "materials", "accessors", "bufferViews", "meshes", "nodes", "scenes", "scene")
    first, second = document(), document()
    second["bufferViews"][0]["byteOffset"] = 0
    second["bufferViews"][1] = {"buffer": 0, "byteLength": 48}
    second["accessors"][1] |= {"byteOffset": 36, "count": 0}
    cache = GltfCache()
    read_gltf(dump(first, order), cache=cache)
    assert drawn(dump(second, order), cache) == drawn(dump(second, order))


@pytest.mark.parametrize("name", ["accessors", "bufferViews", "buffers", "materials", "scenes"])
def test_duplicate_members_do_not_affect_other_documents(name: str) -> None:
    plain = dump(document())
    twice = plain[:-1] + b"," + json.dumps({name: document(3.0)[name] if name == "buffers" else []})[1:].encode()
    cache = GltfCache()
    for data in (twice, plain, plain, plain, twice):
        try:
            expected = drawn(data)
        except GltfError as error:
            with pytest.raises(type(error)) as caught:
                read_gltf(data, cache=cache)
            assert str(caught.value) == str(error)
        else:
            assert drawn(data, cache) == expected


@pytest.mark.parametrize("kind", ["interleaved", "zeros", "sparse"])
def test_one_accessor_of_several_primitives(kind: str) -> None:
    b = Builder()
    values = np.arange(18, dtype=np.float32).reshape(3, 6)
    expected: Any
    if kind == "interleaved":
        points, expected = b.points(b.view(values.tobytes(), byteStride=24)), values[:, :3]
    elif kind == "zeros":
        points, expected = b.points(None), np.zeros((3, 3))
    else:
        points, expected = sparse(b, [1], [(7, 8, 9)], base=False, count=3), np.array(((0, 0, 0), (7, 8, 9), (0, 0, 0)))
    primitives = [{"attributes": {"POSITION": points}, "indices": b.accessor(i, "I")} for i in ([0, 1, 2], [2, 1, 0])]
    b.node(mesh=b.mesh(*primitives))
    assert [mesh.positions.tolist() for mesh in meshes(b.read())] == [expected.tolist()] * 2
