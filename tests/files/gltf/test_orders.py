"""Documents with members in any order or twice: a cached document never changes another one."""

import base64
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.files.gltf import GltfCache, GltfError, read_gltf
from tests.files.gltf.builder import mesh_of, parts
from tests.files.gltf.test_document_cache import outcome

NAMES = ("buffers", "bufferViews", "accessors", "materials", "meshes", "nodes", "scenes", "scene")


def document(z: float = 1.0) -> dict[str, Any]:
    """A triangle at a height, drawn by one of two nodes."""
    data = np.array([[0, 0, z], [1, 0, z], [0, 1, z]], np.float32).tobytes() + np.arange(3, dtype=np.uint32).tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    return {
        "asset": {"version": "2.0", "extras": "long enough to be kept " * 300},
        "buffers": [{"byteLength": len(data), "uri": uri}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 12}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "materials": [{}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "nodes": [{"mesh": 0}, {"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }


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
    second["bufferViews"][1], second["accessors"][1] = (
        {"buffer": 0, "byteLength": 48},
        {
            **second["accessors"][1],
            "byteOffset": 36,
            "count": 0,
        },
    )
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


def several(accessor: dict[str, Any], data: bytes, view: dict[str, Any]) -> bytes:
    """Two meshes of one accessor of positions, each with indices of its own."""
    indices = np.array((0, 1, 2, 2, 1, 0), np.uint32).tobytes()
    uri = "data:application/octet-stream;base64," + base64.b64encode(data + indices).decode()
    source = document()
    source["buffers"] = [{"byteLength": len(data) + 24, "uri": uri}]
    source["bufferViews"] = [view, {"buffer": 0, "byteOffset": len(data), "byteLength": 24}]
    whole = {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"}
    source["accessors"] = [accessor, whole, {**whole, "byteOffset": 12}]
    source["meshes"] = [
        {"primitives": [{"attributes": {"POSITION": 0}, "indices": k} for k in (1, 2)]},
    ]
    return dump(source)


def positions(data: bytes) -> list[list[list[float]]]:
    return [mesh_of(part).positions.tolist() for _, part in parts(read_gltf(data))]


def test_interleaved_positions_of_several_primitives() -> None:
    values = np.arange(18, dtype=np.float32).reshape(3, 6)
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
    data = several(accessor, values.tobytes(), {"buffer": 0, "byteLength": 72, "byteStride": 24})
    assert positions(data) == [values[:, :3].tolist()] * 2


def test_positions_without_a_view_are_zeros_for_several_primitives() -> None:
    accessor = {"componentType": 5126, "count": 3, "type": "VEC3"}
    data = several(accessor, b"", {"buffer": 0, "byteLength": 24})
    assert positions(data) == [[[0.0] * 3] * 3] * 2


def test_sparse_positions_of_several_primitives() -> None:
    values = np.zeros((3, 3), np.float32)
    sparse = np.array((7, 8, 9), np.float32).tobytes() + np.array((1,), np.uint32).tobytes()
    accessor = {
        "bufferView": 0,
        "componentType": 5126,
        "count": 3,
        "type": "VEC3",
        "sparse": {
            "count": 1,
            "values": {"bufferView": 0, "byteOffset": 36},
            "indices": {"bufferView": 0, "byteOffset": 48, "componentType": 5125},
        },
    }
    data = several(accessor, values.tobytes() + sparse, {"buffer": 0, "byteLength": 52})
    assert positions(data) == [[[0.0] * 3, [7.0, 8.0, 9.0], [0.0] * 3]] * 2
