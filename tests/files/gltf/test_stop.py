"""A set stop flag ends reading at any step, and leaves no partial results in a cache."""

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
from tests.files.gltf.builder import TRIANGLE, Builder, mesh_of

POINTS = np.random.default_rng(0).random((100_000, 3), np.float32)


class Enough(Exception):
    pass


def document(b: Builder, *primitives: dict[str, Any], **more: Any) -> bytes:
    """A node that draws the primitives, or the nodes of ``more``."""
    b.node(mesh=b.mesh(*primitives))
    b.json |= more
    return b.text()


def sparse_accessors(count: int = 1000, values: int = 300_000) -> bytes:
    """Accessors that each replace all of their values by the same ones: the file is as small as one of them."""
    b = Builder()
    indices = {"bufferView": b.view(np.arange(values, dtype=np.uint32).tobytes()), "componentType": 5125}
    part = {"indices": indices, "values": {"bufferView": b.view(bytes(12 * values))}, "count": values}
    zeros = b.points(None, type="SCALAR", componentType=5125)
    points = (b.points(None, values, sparse=part) for _ in range(count))
    return document(b, *({"attributes": {"POSITION": p}, "indices": zeros} for p in points))


def primitives_one_by_one(count: int = 2_000) -> bytes:
    """Lines, each with an accessor of its own on one buffer."""
    b = Builder()
    view = b.view(POINTS.tobytes())
    points = (b.points(view, 4, byteOffset=12 * number) for number in range(count))
    return document(b, *({"attributes": {"POSITION": p}, "mode": 1} for p in points))


def materials_one_by_one(count: int = 2_000) -> bytes:
    b = Builder()
    attributes = {"POSITION": b.accessor(TRIANGLE)}
    materials = [{"emissiveFactor": [0, 0, number / count]} for number in range(count)]
    primitives = ({"attributes": attributes, "material": number} for number in range(count))
    return document(b, *primitives, materials=materials)


def vertices_of_nothing() -> bytes:
    """Zeros, without a buffer: a few hundred bytes, dozens of megabytes of arrays, whose tangents have no length."""
    b = Builder()
    types = {"POSITION": "VEC3", "NORMAL": "VEC3", "TEXCOORD_0": "VEC2", "COLOR_0": "VEC4", "TANGENT": "VEC4"}
    return document(b, {"attributes": {name: b.points(None, 400_000, type=each) for name, each in types.items()}})


def numbers_that_are_no_json() -> bytes:
    """NaN: read by a slower parser, which checks the flag at every number."""
    return Builder().draw(POINTS).text()[:-1] + b', "extras": [NaN' + b",1.5" * 50_000 + b"]}"


def deep_nodes(chains: int = 30, depth: int = 240) -> bytes:
    nodes: list[dict[str, Any]] = []
    for chain in range(chains):
        nodes += [{"children": [chain * depth + k + 1], "rotation": [0, 0, 0.1, 0.99]} for k in range(depth - 1)]
        nodes.append({"mesh": 0})
    b = Builder()
    return document(b, {"attributes": {"POSITION": b.accessor(TRIANGLE)}}, nodes=nodes)


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
    b = Builder()
    b.triangle()
    b.json["nodes"] = nodes
    names = list(b.read().root.children)
    assert len(names) == len(set(names)) == count
    assert names[:4] == ["x", "x#2", "x#3", "x#4"]
    assert names[-2:] == ["x#3#2", f"x#{count - 1}"]
