"""A set stop flag ends reading at any step, and leaves no partial results in a cache."""

import base64
import json
import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from itertools import repeat
from typing import Any

import numpy as np
import pytest

from gateway.files.gltf import GltfCache, GltfLimits, read_gltf
from renderers.stop import StopFlag
from tests.files.gltf.builder import mesh_of

Document = dict[str, Any]
POINTS = np.random.default_rng(0).random((100_000, 3), np.float32)


class Enough(Exception):
    pass


def accessor(view: int | None, shape: str, count: int, component: int = 5126, **more: Any) -> Document:
    place = {} if view is None else {"bufferView": view}
    return {**place, "componentType": component, "count": count, "type": shape, **more}


def document(primitives: list[Document], accessors: list[Document], *parts: bytes, **more: Any) -> bytes:
    raw = b"".join(parts)
    views, begin = [], 0
    for part in parts:
        views.append({"buffer": 0, "byteOffset": begin, "byteLength": len(part)})
        begin += len(part)
    uri = f"data:application/octet-stream;base64,{base64.b64encode(raw).decode()}"
    made = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": primitives}],
        "accessors": accessors,
        **({"bufferViews": views, "buffers": [{"byteLength": len(raw), "uri": uri}]} if raw else {}),
    }
    return json.dumps({**made, **more}).encode()


def sparse_accessors(count: int = 1000, values: int = 300_000) -> bytes:
    """Accessors that each replace all of their values by the same ones: the file is as small as one of them."""
    part = {"indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 1}, "count": values}
    accessors = [accessor(None, "VEC3", values, sparse=part) for _ in range(count)]
    accessors.append(accessor(None, "SCALAR", 3, 5125))
    primitives = [{"attributes": {"POSITION": number}, "indices": count} for number in range(count)]
    return document(primitives, accessors, np.arange(values, dtype=np.uint32).tobytes(), bytes(12 * values))


def primitives_one_by_one(count: int = 5_000) -> bytes:
    """Lines, each with an accessor of its own on one buffer."""
    accessors = [accessor(0, "VEC3", 4, byteOffset=12 * number) for number in range(count)]
    return document([{"attributes": {"POSITION": k}, "mode": 1} for k in range(count)], accessors, POINTS.tobytes())


def materials_one_by_one(count: int = 5_000) -> bytes:
    primitives = [{"attributes": {"POSITION": 0}, "material": number} for number in range(count)]
    materials = [{"emissiveFactor": [0, 0, number / count]} for number in range(count)]
    return document(primitives, [accessor(0, "VEC3", 3)], POINTS.tobytes(), materials=materials)


def vertices_of_nothing() -> bytes:
    """Zeros, without a buffer: a few hundred bytes, a hundred megabytes of arrays, whose tangents have no length."""
    shapes = {"POSITION": "VEC3", "NORMAL": "VEC3", "TEXCOORD_0": "VEC2", "COLOR_0": "VEC4", "TANGENT": "VEC4"}
    accessors = [accessor(None, shape, 1_000_000) for shape in shapes.values()]
    return document([{"attributes": dict(zip(shapes, range(len(shapes)), strict=True))}], accessors)


def numbers_that_are_no_json() -> bytes:
    """NaN: read by a slower parser, which checks the flag at every number."""
    text = document([{"attributes": {"POSITION": 0}}], [accessor(0, "VEC3", 3)], POINTS.tobytes())
    return text[:-1] + b', "extras": [NaN' + b",1.5" * 200_000 + b"]}"


def deep_nodes(chains: int = 80, depth: int = 240) -> bytes:
    nodes: list[Document] = []
    for chain in range(chains):
        nodes += [{"children": [chain * depth + k + 1], "rotation": [0, 0, 0.1, 0.99]} for k in range(depth - 1)]
        nodes.append({"mesh": 0})
    roots = [{"nodes": [chain * depth for chain in range(chains)]}]
    return document(
        [{"attributes": {"POSITION": 0}}], [accessor(0, "VEC3", 3)], POINTS.tobytes(), nodes=nodes, scenes=roots
    )


DOCUMENTS: tuple[Callable[[], bytes], ...] = (
    sparse_accessors,
    primitives_one_by_one,
    materials_one_by_one,
    vertices_of_nothing,
    numbers_that_are_no_json,
    deep_nodes,
)


class CountingFlag(StopFlag):
    """Is set at the check from Python with this number."""

    __slots__ = ("left",)

    def __init__(self, left: int) -> None:
        super().__init__()
        self.left = left

    def check(self) -> None:
        self.left -= 1
        if self.left <= 0:
            self.set(Enough())
        super().check()


@pytest.mark.parametrize("make", DOCUMENTS)
def test_stop_flag_ends_reading_anywhere(make: Callable[[], bytes]) -> None:
    """At the first check, in the middle and at the last one. The same cache then gives the complete result."""
    data = make()
    counting = CountingFlag(1 << 62)
    whole = counting.run(lambda: read_gltf(data, cache=GltfCache()))
    check_count = (1 << 62) - counting.left
    assert check_count > 4
    for last in (1, check_count // 2, check_count):
        flag, cache = CountingFlag(last), GltfCache()
        with pytest.raises(Enough):
            flag.run(partial(read_gltf, data, cache=cache))
    again = read_gltf(data, cache=cache)
    assert (again.element_count, again.warnings) == (whole.element_count, whole.warnings)
    for parts, others in zip(again.parts, whole.parts, strict=True):
        for part, other in zip(parts or (), others or (), strict=True):
            for name in ("positions", "elements", "normals", "tangents"):
                mine, theirs = getattr(mesh_of(part), name), getattr(mesh_of(other), name)
                assert mine is theirs is None or np.array_equal(mine, theirs)


@pytest.mark.parametrize("make", [sparse_accessors, primitives_one_by_one, vertices_of_nothing])
def test_stop_flag_ends_kernels(make: Callable[[], bytes]) -> None:
    """Set by another thread, in the middle."""
    data, flag = make(), StopFlag()
    timer = threading.Timer(0.1, flag.set, (Enough(),))
    timer.start()
    read = partial(flag.run, partial(read_gltf, data, limits=GltfLimits()))
    with pytest.raises(Enough):
        deque((read() for _ in repeat(None)), 0)  # until the flag is set
    timer.join()


def test_many_siblings_of_one_name_are_fast() -> None:
    """Counting from 1 for each of 99,000 siblings took five thousand million steps."""
    count = 99_000
    nodes = [{"mesh": 0, "name": "x"} for _ in range(count - 2)] + [{"name": "x#3"}, {"name": "x"}]
    scene = read_gltf(
        document(
            [{"attributes": {"POSITION": 0}}],
            [accessor(0, "VEC3", 3)],
            POINTS.tobytes(),
            nodes=nodes,
            scenes=[{"nodes": list(range(count))}],
        )
    )
    names = list(scene.root.children)
    assert len(names) == len(set(names)) == count
    assert names[:4] == ["x", "x#2", "x#3", "x#4"]
    assert names[-2:] == ["x#3#2", f"x#{count - 1}"]
