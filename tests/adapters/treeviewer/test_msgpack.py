"""Requests in MessagePack: the same commands as in JSON give the same tree and responses; long arrays are bytes."""

import random
import struct
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gateway.adapters.treeviewer import msgpack_kernels, responses
from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.number_arrays import DTYPES, EXTENSION, unpack
from gateway.scene.tree.geometry import Line, Part, PointCloud, Surface
from scenegate.messages import wire
from scenegate.messages.request_encoding import pack
from tests.adapters.treeviewer.conversation import BOX, Viewer

PADDING = 64 * 1024
MESH = {"type": "mesh_data", "vertices": np.zeros((3, 3))}
VERTICES = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.5]]


def packed(value: Any) -> Any:
    return pack(np.asarray(value))


def message(request: Any, utime: int = 7, version: tuple[int, int] = (1, 0)) -> bytes:
    data = request if isinstance(request, bytes) else msgspec.msgpack.encode(request)
    return wire.encode(data, utime, wire.BINARY, version)


def tell(viewer: Viewer, request: Any, **options: Any) -> dict[str, Any]:
    data = message(request, **options)
    assert wire.decode(data).format == wire.BINARY
    reply = wire.decode(responses.encode(viewer.protocol.handle(data), wire.BINARY))
    assert (reply.format, reply.major, reply.minor, reply.fault) == ("treeviewer_msgpack", 1, 0, "")
    answer: dict[str, Any] = msgspec.msgpack.decode(reply.data)
    return answer


def shape(viewer: Viewer, path: str = "a") -> Any:
    (part,) = viewer.parts(path)
    return part.shape


def set_one(geometry: dict[str, Any], padding: int = 0) -> dict[str, Any]:
    return {"setgeometry": [{"path": ["a"], "geometry": geometry}], "list": bytes(padding)}


@pytest.mark.parametrize("padding", [0, PADDING], ids=["small", "big"])
def test_arrays_come_as_bytes(padding: int) -> None:
    viewer = Viewer()
    chance = np.random.default_rng(1)
    points, rgb = chance.random((50, 3)).astype(np.float32), chance.integers(0, 256, (50, 3)).astype(np.uint8)
    channels = {"rgb": packed(rgb), "t": packed(points[:, 0])}
    cloud = {"type": "pointcloud", "points": packed(points), "channels": channels}
    assert tell(viewer, set_one(cloud, padding))["status"] == 0
    found: Any = shape(viewer)
    np.testing.assert_array_equal(found.points, points)
    np.testing.assert_allclose(found.channels["rgb"], rgb / 255.0, rtol=1e-6)
    np.testing.assert_array_equal(found.channels["t"], points[:, 0])
    assert found.points.flags.owndata
    assert found.points.flags.aligned

    faces = np.array([[0, 1, 2]], np.uint16)
    mesh = {"type": "mesh_data", "vertices": packed(np.array(VERTICES)), "faces": packed(faces)}
    assert tell(viewer, set_one(mesh, padding))["status"] == 0
    assert isinstance(shape(viewer), Surface)
    assert shape(viewer).mesh.elements.shape == (1, 3)

    line = {"type": "line", "points": packed(np.array(VERTICES, np.float32))}
    assert tell(viewer, set_one(line, padding))["status"] == 0
    assert isinstance(shape(viewer), Line)

    lidar = {"type": "planar_lidar", "ranges": packed(np.ones(4)), "angle_start": 0, "angle_step": 1}
    assert tell(viewer, set_one(lidar, padding))["status"] == 0
    assert len(shape(viewer).points) == 4


@pytest.mark.parametrize(
    ("geometry", "reason"),
    [
        ({"points": np.zeros((5, 2))}, "points has rows of 2, not rows of 3 numbers"),
        ({"points": np.zeros(6)}, "points has numbers, not rows of 3 numbers"),
        ({"points": np.zeros((9, 3))}, "points has 9 rows, the limit is 8"),
        ({"points": b"f4"}, "points has 2 bytes, less than an array's head"),
        ({"points": b"c8\1\0" + struct.pack("<I", 0)}, "points has numbers of type b'c8', not of f2, f4"),
        ({"points": b"f4\3\0" + bytes(12)}, "points has 3 dimensions, not rows of 3 numbers"),
        ({"points": b"f4\4\0" + bytes(16)}, "points has 4 dimensions, 1 to 3 are possible"),
        ({"points": b"f4\2\0" + bytes(4)}, "points has 2 dimensions, 1 to 3 are possible"),
        ({"points": b"f4\1\7" + bytes(4)}, "points has 7 in byte 3 of its head, which must be 0"),
        ({"points": b"f4\2\0" + struct.pack("<2I", 2, 3) + bytes(23)}, "has 23 bytes of numbers, its shape needs 24"),
        ({**MESH, "faces": np.array([[0, 1, 2], [0, 3, 1]])}, "faces has 3 in row 1, but there are 3 vertices"),
        ({**MESH, "faces": np.array([[0, 1, -1]])}, "faces has -1 in row 0, but there are 3 vertices"),
        ({**MESH, "faces": np.zeros((1, 3))}, "faces has floating-point"),
    ],
)
def test_rejects_invalid_arrays(geometry: dict[str, Any], reason: str) -> None:
    extension = partial(msgspec.msgpack.Ext, EXTENSION)
    kinds: dict[type, Callable[[Any], Any]] = {bytes: extension, np.ndarray: pack, str: str}
    made = {name: kinds[type(value)](value) for name, value in geometry.items()}
    answer = tell(Viewer(Limits(points=8)), set_one({"type": "pointcloud", **made}))
    assert answer["status"] == -3
    assert reason in answer["error"]


def test_ignores_invalid_channels_with_a_warning() -> None:
    viewer = Viewer()
    channels = {"rgb": packed(np.zeros((4, 3))), 7: packed(np.zeros(3)), "x": packed(np.zeros((3, 20))), "y": b"bin"}
    answer = tell(viewer, set_one({"type": "pointcloud", "points": packed(np.zeros((3, 3))), "channels": channels}))
    assert answer["status"] == 0
    assert shape(viewer).channels == {}
    assert [text.split("channel ")[1].split(" of 1 or")[0] for text in answer["warnings"]] == [
        '"rgb" has 4 values for 3 points; it is ignored',
        "7 has no text as its name; it is ignored",
        '"x" has rows of 20, not rows',
        '"y" must be a list of rows',
    ]


def test_rejects_other_versions() -> None:
    answer = tell(Viewer(), {}, version=(2, 0))
    formats = {"treeviewer_json": ["1.0"], "treeviewer_msgpack": ["1.0"]}
    assert answer == {"timestamp": 7, "status": -2, "supported_formats": formats}


def test_rejects_invalid_messagepack() -> None:
    invalid = dict.fromkeys((b"\xc1", b"\x81\xa1", b"\x91" * 5000, b""), "is not valid MessagePack")
    for data, reason in {**invalid, b"\x93\x01\x02\x03": "must be a MessagePack map, not [1, 2, 3]"}.items():
        answer = tell(Viewer(), data)
        assert (answer["status"], reason in answer["error"]) == (-3, True), answer


def big(body: bytes) -> bytes:
    """Return a map with ``body`` under x, of more than ``PADDING`` bytes."""
    filler = bytes([0xC6]) + struct.pack(">I", PADDING) + bytes(PADDING)
    return b"\x82\xa1x" + body + b"\xa1y" + filler


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (big(b"\xc1"), "byte c1 is never used"),
        (big(b"\x01")[:-1], "it ends too early"),
        (big(b"\x01") + b"\x01", "bytes follow its end"),
        (big(b"\xdd\xff\xff\xff\xff"), "it ends too early"),
        (big(b"\xdc\x03\xe9" + bytes(1001)), "more than 1000 objects besides its arrays"),
        (b"\xdd" + struct.pack(">I", 100) + bytes(100) + bytes(PADDING), "bytes follow"),
        (b"\xc6" + struct.pack(">I", PADDING) + bytes(PADDING), "must be a MessagePack map, not <bytes>"),
    ],
)
def test_counts_values_of_big_requests_first(data: bytes, reason: str) -> None:
    answer = tell(Viewer(Limits(binary_objects=1000)), data)
    assert answer["status"] == -3
    assert reason in answer["error"]


# --- comparison with JSON

numbers = st.floats(-1e6, 1e6) | st.integers(-100, 100) | st.just(float("nan"))
names = st.sampled_from(["a", "b", "ü", 1, 2**60])
paths = st.lists(names, max_size=3)
solids: st.SearchStrategy[Any] = st.sampled_from(
    [
        BOX,
        {"type": "box", "lengths": 2},
        {"type": "sphere", "radius": True, "color": [1, 0.5, 0]},
        {"type": "sphere", "radius": float("nan")},
        {"type": "cylinder", "radius": 1, "length": 2, "transform": {"quaternion": [0, 1, 0, 0]}},
        {"type": "pointcloud", "points": VERTICES, "channels": {"rgb": VERTICES, "intensity": []}},
        {"type": "mesh_data", "vertices": VERTICES, "faces": [[0, 1, 2]], "color": [1, 0, 0, 0.5]},
        {"type": "mesh_data", "vertices": VERTICES, "faces": [[0, 1, 3]]},
        {"type": "line", "points": VERTICES, "radius": False},
        {"type": "triad"},
        {"type": "teapot"},
        {"type": 7},
        [],
        None,
    ]
)
oddities = st.sampled_from([None, {}, 5, "x", [None], [3], {"path": ["a"]}])
transforms = st.fixed_dictionaries(
    {}, optional={"translation": st.lists(numbers, max_size=4), "quaternion": st.lists(numbers, min_size=4, max_size=4)}
)
set_geometry = st.fixed_dictionaries(
    {"path": paths}, optional={"geometry": solids, "geometries": st.lists(solids, max_size=2), "extra": st.none()}
)
set_transform = st.fixed_dictionaries({"path": paths, "transform": transforms})
requests = st.fixed_dictionaries(
    {},
    optional={
        "delete": oddities | st.lists(st.fixed_dictionaries({"path": paths}), max_size=2),
        "setgeometry": oddities | st.lists(set_geometry, max_size=4),
        "settransform": oddities | st.lists(set_transform, max_size=4),
        "load": st.lists(set_geometry, max_size=1),
        "draw": st.none(),
        "timestamp": st.integers(0, 9),
    },
)


def described(viewer: Viewer) -> list[Any]:
    return [
        (path, node.matrix.tobytes(), node.parts is not None and [parted(part) for part in node.parts])
        for path, node in viewer.live.snapshot.root.walk()
    ]


def parted(part: Part) -> Any:
    it: Any = part.shape
    if isinstance(it, PointCloud):
        it = (it.points.tobytes(), {name: values.tobytes() for name, values in it.channels.items()})
    elif isinstance(it, Surface):
        it = (it.mesh.positions.tobytes(), it.mesh.elements.tobytes())
    elif isinstance(it, Line):
        it = (it.points.tobytes(), it.radius, it.closed)
    return it, part.material, part.X_node_part.tobytes(), part.kind


@settings(deadline=None, max_examples=100)
@given(st.lists(requests, max_size=3), st.booleans())
def test_same_result_as_json(several: list[dict[str, Any]], padded: bool) -> None:
    in_json, in_binary = Viewer(), Viewer()
    for request in several:
        padding = {"list": bytes(PADDING)} if padded else {}
        assert tell(in_binary, request | padding) == in_json.tell(request)
    assert described(in_binary) == described(in_json)


@settings(deadline=None, max_examples=100)
@given(
    st.sampled_from(sorted(DTYPES)),
    st.tuples(st.integers(0, 5)) | st.tuples(st.integers(0, 5), st.integers(1, 4)),
    st.integers(0, 7),
)
def test_packed_arrays_round_trip(name: str, size: tuple[int, ...], offset: int) -> None:
    values: NDArray[Any] = (np.arange(np.prod(size)) % 100).reshape(size).astype(DTYPES[name])
    payload = memoryview(bytes(offset) + bytes(pack(values).data))[offset:]
    found = unpack(payload)
    assert found.fault == ""
    assert found.values is not None
    assert found.values.dtype == values.dtype
    np.testing.assert_array_equal(found.values, values)


scalars = st.none() | st.integers(-(2**63), 2**64 - 1) | st.floats() | st.text() | st.binary()


@settings(deadline=None, max_examples=50)
@given(st.recursive(scalars, lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner)))
def test_counts_values(value: Any) -> None:
    def count(it: Any) -> int:
        if isinstance(it, list):
            return 1 + sum(map(count, it))
        if isinstance(it, dict):
            return 1 + sum(count(k) + count(v) for k, v in it.items())
        return 1 + (len(it.encode()) // 64 if isinstance(it, str) else 0)

    data = np.frombuffer(msgspec.msgpack.encode(value), np.uint8)
    assert msgpack_kernels.count_values(data, 1 << 40) == count(value)
    if len(data) > 1:
        assert msgpack_kernels.count_values(data[:-1], 1 << 40) == msgpack_kernels.TRUNCATED


def test_survives_mutated_messages() -> None:
    chance = random.Random(4)
    viewer = Viewer(Limits(binary_objects=100_000))
    arrays = {"points": packed(np.zeros((9, 3), np.float32)), "channels": {"rgb": packed(np.zeros((9, 3), np.uint8))}}
    corners, faces = packed(np.array(VERTICES, np.float32)), packed(np.array([[0, 1, 2]], np.uint32))
    mesh = {"type": "mesh_data", "vertices": corners, "faces": faces}
    good = {
        "delete": [{"path": ["b"]}],
        "setgeometry": [
            {"path": ["a"], "geometries": [BOX, {"type": "pointcloud", **arrays}, mesh]},
            {"path": ["b", 1], "geometry": {"type": "sphere", "radius": 1.5}},
        ],
        "settransform": [{"path": ["a"], "transform": {"translation": [1, 2, 3]}}],
    }
    for padding in (0, PADDING):
        whole = msgspec.msgpack.encode(good | {"list": bytes(padding)})
        useful = len(whole) - padding
        for _ in range(3000 if not padding else 500):
            data = bytearray(whole)
            for _ in range(chance.randrange(1, 4)):
                data[chance.randrange(useful)] = chance.randrange(256)
            if chance.random() < 0.2:
                del data[chance.randrange(len(data)) :]
            viewer.protocol.handle(message(bytes(data)))
        assert tell(viewer, good)["status"] == 0
