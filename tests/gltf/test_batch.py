"""Meshes that are read together are what each is when it is read alone, whatever documents say."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.gltf import GltfError, GltfLimits, MeshCache, read_gltf
from gateway.gltf.batch import _SMALL
from gateway.gltf.meshes import Meshes
from tests.gltf.builder import mesh_of, parts
from tests.gltf.test_document_cache import outcome

FLOATS, VERTICES = 300, 6
"""In each buffer, of floats and then of indices; and the vertices that indices may name."""


def buffer(seed: int) -> dict[str, Any]:
    """Floats, some of them normals and one not finite; indices of 8, 16 and 32 bits, some out of range."""
    rng = np.random.default_rng(seed)
    floats = rng.normal(size=FLOATS).astype(np.float32)
    rows = floats[:90].reshape(-1, 3)
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    floats[200] = np.nan
    indices = rng.integers(0, VERTICES, 60)
    indices[50] = 255
    data = floats.tobytes() + b"".join(indices.astype(kind).tobytes() for kind in (np.uint32, np.uint16, np.uint8))
    return {"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}


BUFFERS = [buffer(0), buffer(1), buffer(0), {"byteLength": 9, "uri": "data:application/octet-stream;base64,AAAA$AAA"}]
ODD = st.sampled_from((None, -1, -2, 7, 1 << 31, 1 << 63, 1 << 70, -(1 << 63), -(1 << 70)))


def usually(value: Any, others: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.integers(0, 59).flatmap(lambda x: others if x == 59 else st.just(value))


@st.composite
def accessors(draw: st.DrawFn) -> tuple[dict[str, Any], dict[str, Any]]:
    """An accessor and its view; most have no fault."""
    shape = draw(st.sampled_from(("VEC3", "VEC3", "VEC3", "VEC2", "VEC4", "SCALAR", "SCALAR", "SCALAR")))
    if shape == "SCALAR":
        component, begin, size = draw(st.sampled_from(((5125, 0, 4), (5123, 240, 2), (5121, 360, 1))))
        start, count = (
            4 * FLOATS + begin + size * draw(st.sampled_from((0, 3, 5))),
            draw(st.sampled_from((6, 9, 6, 9, 6, 9, 12, 7, 60))),
        )
    else:
        component, size = draw(
            st.sampled_from((*[(5126, 4)] * 7, (5120, 1), (5121, 1), (5122, 2), (5123, 2), (5125, 4)))
        )
        start = 4 * draw(st.sampled_from((0, 3, 90, 93)))
        count, size = draw(st.sampled_from((VERTICES, VERTICES, 9, 40))), size * int(shape[3])
    accessor = {
        "bufferView": 0,
        "byteOffset": draw(usually(0, st.one_of(ODD, st.sampled_from((4, 2))))),
        "componentType": draw(usually(component, st.sampled_from((5120, 5124, 5130, 5126, None, 1)))),
        "count": draw(usually(count, ODD)),
        "normalized": draw(usually(component in (5120, 5121, 5122, 5123), st.sampled_from((None, False, True)))),
        "type": draw(usually(shape, st.sampled_from(("MAT2", None, "VEC4")))),
    }
    if draw(usually(False, st.just(True))):
        accessor["sparse"] = {
            "count": 1,
            "indices": {"bufferView": 0, "byteOffset": 0, "componentType": draw(st.sampled_from((5125, 5121)))},
            "values": {"bufferView": 0},
        }
    view = {
        "buffer": draw(usually(draw(st.sampled_from((0, 1, 2))), st.sampled_from((3, 9, None)))),
        "byteOffset": draw(usually(start, ODD)),
        "byteLength": draw(usually(count * size, st.one_of(ODD, st.just(1500)))),
        "byteStride": None,
    }
    if shape != "SCALAR" and draw(st.integers(0, 3)) == 0:
        view["byteStride"] = draw(st.one_of(st.sampled_from((size, 20, 24, 18, 4, 0)), ODD))
        view["byteLength"] = 1500 - start
    return accessor, view


@st.composite
def documents(draw: st.DrawFn) -> dict[str, Any]:
    """Meshes whose primitives share accessors of all sorts."""
    made = draw(st.lists(accessors(), min_size=4, max_size=8))
    for at, (accessor, _) in enumerate(made):
        accessor["bufferView"] = draw(usually(at, ODD))
        if "sparse" in accessor:
            accessor["sparse"]["indices"]["bufferView"] = accessor["sparse"]["values"]["bufferView"] = at
    of = {shape: [i for i, (a, _) in enumerate(made) if a["type"] == shape] for shape in ("VEC2", "VEC3", "VEC4")}
    indices = [i for i, (a, _) in enumerate(made) if a["type"] == "SCALAR"]

    def one(among: list[int]) -> Any:
        return draw(usually(draw(st.sampled_from(among)) if among else 0, ODD))

    primitives: list[Any] = []
    for _ in range(draw(st.integers(1, 5))):
        attributes = {"POSITION": one(of["VEC3"])}
        for name, shape in (("NORMAL", "VEC3"), ("TEXCOORD_0", "VEC2"), ("COLOR_0", "VEC4"), ("TANGENT", "VEC4")):
            if draw(st.integers(0, 3)) == 0:
                attributes[name] = one(of[shape])
        primitives.append(
            {
                "attributes": attributes | draw(usually({}, st.sampled_from(({"JOINTS_0": 0}, {"_OWN": None})))),
                "indices": one(indices) if indices and draw(st.integers(0, 4)) else None,
                "mode": draw(usually(4, st.sampled_from((None, 0, 1, 5, 9)))),
            }
        )
    return {
        "asset": {"version": "2.0"},
        "accessors": [accessor for accessor, _ in made],
        "bufferViews": [view for _, view in made],
        "buffers": BUFFERS,
        "materials": [{}],
        "meshes": [{"primitives": [primitive]} for primitive in primitives],
        "nodes": [{"mesh": at} for at in range(len(primitives))],
    }


def told(source: dict[str, Any], cache: MeshCache | None = None, limits: GltfLimits | None = None) -> Any:
    """What the reader makes of a document, or says."""
    try:
        scene = read_gltf(json.dumps(source).encode(), cache=cache, limits=limits)
    except GltfError as error:
        return str(error)
    for _, part in parts(scene):
        mesh = mesh_of(part)
        assert mesh.positions.flags.aligned
        assert mesh.elements.flags.aligned
        assert mesh.normals is None or mesh.normals.flags.aligned
        assert mesh.uv0 is None or mesh.uv0.flags.aligned
    names = ("normals", "uv0", "uv1", "colors", "tangents")
    arrays = [
        [None if (array := getattr(mesh_of(part), name)) is None else array.tobytes() for name in names]
        for _, part in parts(scene)
    ]
    return outcome(scene), arrays


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> Any:
    """``told`` with every mesh read alone."""

    def tell(source: dict[str, Any], limits: GltfLimits | None = None) -> Any:
        with monkeypatch.context() as patch:
            patch.setattr(Meshes, "prepare", lambda self, primitives: None)
            return told(source, limits=limits)

    return tell


@settings(deadline=None, max_examples=50, derandomize=True)
@given(st.lists(documents(), min_size=1, max_size=3))
def test_together_and_alone_are_the_same(sources: list[dict[str, Any]]) -> None:
    cache = MeshCache()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Meshes, "prepare", lambda self, primitives: None)
        expected = [told(source) for source in sources]
    for source, alone in zip(sources, expected, strict=True):
        assert told(source) == alone
    # Clients that share a cache do not share more than what is equal.
    for _ in range(2):
        for source, alone in zip(sources, expected, strict=True):
            assert told(source, cache) == alone


def grid(count: int, *, kind: int, dtype: type[Any], z: float) -> tuple[bytes, dict[str, Any], dict[str, Any]]:
    """A strip of ``count`` triangles, with its accessors of positions and indices."""
    n = count + 2
    x = np.arange(n, dtype=np.float32)
    positions = np.stack([x, x % 2, np.sin(x) + np.float32(z)], axis=1).astype(np.float32)
    indices = (np.arange(count)[:, None] + (0, 1, 2)).astype(dtype)
    data = positions.tobytes() + indices.tobytes()
    points = {"componentType": 5126, "count": n, "type": "VEC3"}
    return data, points, {"componentType": kind, "count": 3 * count, "type": "SCALAR"}


@pytest.mark.parametrize("counts", [(_SMALL - 2, _SMALL - 1, _SMALL + 1, 3), (1, 2, 3), (_SMALL, 5, _SMALL), (3000,)])
@pytest.mark.parametrize(("kind", "dtype"), [(5123, np.uint16), (5125, np.uint32)])
def test_small_and_large_meshes_side_by_side(alone: Any, counts: tuple[int, ...], kind: int, dtype: type[Any]) -> None:
    source: dict[str, Any] = {key: [] for key in ("accessors", "bufferViews", "buffers", "meshes", "nodes")}
    for at, count in enumerate(counts):
        data, points, indices = grid(count, kind=kind, dtype=dtype, z=at)
        uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
        source["buffers"].append({"byteLength": len(data), "uri": uri})
        length = 12 * points["count"]
        source["bufferViews"] += [
            {"buffer": at, "byteLength": length},
            {"buffer": at, "byteOffset": length, "byteLength": len(data) - length},
        ]
        source["accessors"] += [points | {"bufferView": 2 * at}, indices | {"bufferView": 2 * at + 1}]
        source["meshes"].append({"primitives": [{"attributes": {"POSITION": 2 * at}, "indices": 2 * at + 1}]})
        source["nodes"].append({"mesh": at})
    assert told(source) == alone(source)
    for _, part in parts(read_gltf(json.dumps(source).encode())):
        for array in (mesh_of(part).positions, mesh_of(part).elements, mesh_of(part).normals):
            assert array is not None
            assert not array.flags.writeable
    vertices, triangles = sum(counts) + 2 * len(counts), sum(counts)
    for limits in (
        GltfLimits(max_vertices=vertices),
        GltfLimits(max_vertices=vertices - 1),
        GltfLimits(max_elements=triangles - 1),
        GltfLimits(max_primitives=len(counts) - 1),
        GltfLimits(max_buffer_bytes=sum(buffer["byteLength"] for buffer in source["buffers"]) - 3),
        GltfLimits(max_mesh_bytes=1000),
    ):
        assert told(source, limits=limits) == alone(source, limits)


def faulty(change: dict[str, Any]) -> dict[str, Any]:
    """Two meshes, of six vertices with everything; ``change`` has members of accessors, views or attributes by the
    attribute that they are about."""
    shapes = {"POSITION": "VEC3", "NORMAL": "VEC3", "TEXCOORD_0": "VEC2", "COLOR_0": "VEC4", "TANGENT": "VEC4"}
    source: dict[str, Any] = {
        "accessors": [],
        "bufferViews": [],
        "buffers": BUFFERS,
        "nodes": [{"mesh": 0}, {"mesh": 1}],
    }
    attributes: dict[str, Any] = {}
    for at, (name, shape) in enumerate(shapes.items()):
        attributes[name] = at
        start = {"POSITION": 400, "NORMAL": 0}.get(name, 200)
        source["bufferViews"].append({"buffer": 0, "byteOffset": start, "byteLength": 240})
        source["accessors"].append({"bufferView": at, "componentType": 5126, "count": VERTICES, "type": shape})
    source["bufferViews"].append({"buffer": 0, "byteOffset": 4 * FLOATS, "byteLength": 240})
    source["accessors"].append({"bufferView": 5, "componentType": 5125, "count": 30, "type": "SCALAR"})
    indices: Any = 5
    for name, value in change.items():
        if name == "attributes":
            attributes |= value
        elif name == "primitive":
            indices = value
        else:
            at = [*shapes, "indices"].index(name)
            source["accessors"][at] |= value.get("accessor", {})
            source["bufferViews"][at] |= value.get("view", {})
    first = {"attributes": attributes, "indices": indices}
    source["meshes"] = [{"primitives": [first]}, {"primitives": [{"attributes": {"POSITION": 0}, "indices": 5}]}]
    return source


NARROW = {"view": {"byteOffset": 4 * FLOATS + 240, "byteLength": 180}}
FAULTS: list[dict[str, Any]] = [
    {},
    *[{name: {"accessor": {"count": VERTICES - 1}}} for name in ("NORMAL", "TEXCOORD_0", "COLOR_0", "TANGENT")],
    {"POSITION": {"accessor": {"count": 12}}},
    {"POSITION": {"accessor": {"count": 13}}},
    {"POSITION": {"accessor": {"count": 0}}},
    *[{name: {"accessor": {"byteOffset": 2}}} for name in ("POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0", "indices")],
    *[{name: {"accessor": {"byteOffset": 4}}} for name in ("POSITION", "NORMAL", "TEXCOORD_0", "COLOR_0", "indices")],
    *[{name: {"view": {"byteStride": stride}}} for name in ("POSITION", "NORMAL") for stride in (0, 8, 12, 24, 300)],
    *[{"indices": {"accessor": {"count": count}}} for count in (0, 1, 2, 29, 31, 60, 61)],
    *[{"indices": {"accessor": {"componentType": kind}}} for kind in (5126, 5124, 5120, None, 0)],
    *[{"indices": {"accessor": {"componentType": 5123, "byteOffset": odd}, **NARROW}} for odd in (0, 1, 2, 6)],
    *[{"indices": {"accessor": {"componentType": 5121, "byteOffset": odd}, **NARROW}} for odd in (0, 1, 120, 121)],
    {"indices": {"accessor": {"componentType": 5121, "byteOffset": 120, "count": 60}, **NARROW}},
    {"indices": {"accessor": {"normalized": True}}},
    {"POSITION": {"view": {"byteOffset": 780}}},
    {"TEXCOORD_0": {"view": {"byteOffset": 780}}},
    {"NORMAL": {"view": {"byteOffset": 780}}},
    {"NORMAL": {"view": {"byteOffset": 500}}},
    {"COLOR_0": {"accessor": {"componentType": 5121, "normalized": True}}},
    {"COLOR_0": {"accessor": {"type": "VEC3"}}},
    {"TANGENT": {"accessor": {"type": "VEC3"}}},
    {"TEXCOORD_0": {"accessor": {"type": "VEC3"}}},
    {"POSITION": {"accessor": {"type": "VEC4"}}},
    *[{"POSITION": {"view": {"byteLength": length}}} for length in (None, -1, 71, 72, 1 << 70)],
    *[{"POSITION": {"view": {"byteOffset": offset}}} for offset in (None, -4, 1 << 40, 1 << 63, 1308)],
    *[{"POSITION": {"view": {"buffer": at}}} for at in (None, -1, 1, 2, 3, 4)],
    *[{"POSITION": {"accessor": {"count": count}}} for count in (None, -1, 1 << 31, 1 << 62, 1 << 64)],
    *[
        {"attributes": {name: at}}
        for name in ("NORMAL", "POSITION", "JOINTS_0")
        for at in (None, -1, 0, 5, 99, 1 << 65)
    ],
    *[{"primitive": at} for at in (None, -1, 0, 99, -(1 << 63))],
]


@pytest.mark.parametrize("change", FAULTS)
def test_faults_are_told_as_if_there_was_one_mesh(alone: Any, change: dict[str, Any]) -> None:
    source = faulty(change)
    expected = alone(source)
    assert told(source) == expected
    cache = MeshCache()
    told(faulty({}), cache)
    for _ in range(2):
        assert told(source, cache) == expected


def test_boxes_share_the_arrays_of_what_they_have_in_common() -> None:
    (data, points, indices), other = (
        grid(5, kind=5125, dtype=np.uint32, z=0.0),
        grid(5, kind=5125, dtype=np.uint32, z=1.0),
    )
    length = 12 * points["count"]
    contents = (data[:length], other[0][:length], data[length:], bytes(8 * points["count"]))
    uris = ["data:application/octet-stream;base64," + base64.b64encode(content).decode() for content in contents]
    source: dict[str, Any] = {
        "buffers": [{"byteLength": len(c), "uri": uri} for c, uri in zip(contents, uris, strict=True)],
        "bufferViews": [{"buffer": at, "byteLength": len(content)} for at, content in enumerate(contents)],
        "accessors": [points | {"bufferView": at} for at in (0, 1)]
        + [indices | {"bufferView": 2}, points | {"bufferView": 3, "type": "VEC2"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": at, "TEXCOORD_0": 3}, "indices": 2}]} for at in (0, 1)],
        "nodes": [{"mesh": 0}, {"mesh": 1}],
    }
    cache = MeshCache()
    one, two = (mesh_of(part) for _, part in parts(read_gltf(json.dumps(source).encode(), cache=cache)))
    assert one.positions.tobytes() == contents[0]
    assert two.positions.tobytes() == contents[1]
    assert one.elements is two.elements
    assert one.uv0 is two.uv0
    assert one.normals is not two.normals
    assert cache.stats.nbytes == sum(map(len, contents)) + 2 * length  # with the normals of each
