from typing import Any

import numpy as np
import pytest

from gateway.files.gltf import GltfError, GltfLimits
from tests.files.gltf.builder import COMPONENT, TRIANGLE, Builder, drawn, meshes, only_mesh


@pytest.mark.parametrize("dtype", ["B", "H", "I"])
def test_indices_of_every_type(dtype: str) -> None:
    b = Builder()
    positions = np.arange(12, dtype=np.float32).reshape(4, 3)
    b.draw(positions)
    b.json["meshes"][0]["primitives"][0]["indices"] = b.accessor([0, 1, 2, 2, 1, 3], dtype)
    mesh = only_mesh(b.read())
    assert mesh.elements.dtype == np.uint32
    assert mesh.elements.tolist() == [[0, 1, 2], [2, 1, 3]]
    assert (mesh.positions == positions).all()


def test_arrays_are_read_only_contiguous_and_aligned() -> None:
    mesh = drawn(NORMAL=TRIANGLE, TEXCOORD_0=TRIANGLE[:, :2])
    for array in (mesh.positions, mesh.elements, mesh.normals, mesh.uv0):
        assert array.flags.c_contiguous
        assert array.flags.aligned
        assert not array.flags.writeable


@pytest.mark.parametrize(
    ("dtype", "stored", "expected"),
    [
        ("B", [0, 255, 51], [0, 1, 0.2]),
        ("H", [0, 65535, 13107], [0, 1, 0.2]),
        ("b", [-127, 127, -128], [-1, 1, -1]),
        ("h", [-32767, 32767, -32768], [-1, 1, -1]),
    ],
)
def test_normalized_integers(dtype: str, stored: list[int], expected: list[float]) -> None:
    b = Builder()
    uv = b.accessor(np.column_stack([stored, stored]), dtype, normalized=True)
    mesh = only_mesh(b.draw(TEXCOORD_0=uv).read())
    np.testing.assert_allclose(mesh.uv0[:, 0], expected, atol=1e-7)


@pytest.mark.parametrize("dtype", ["b", "B", "h", "H", "f", "d"])
def test_quantised_positions(dtype: str) -> None:
    b = Builder()
    mesh = only_mesh(b.draw(b.accessor([(0, 0, 0), (100, 0, 0), (0, 100, 3)], dtype)).read())
    assert mesh.positions.dtype == np.float32
    assert mesh.positions.tolist() == [[0, 0, 0], [100, 0, 0], [0, 100, 3]]


def test_interleaved() -> None:
    b = Builder()
    record = np.zeros(3, dtype=[("p", "<f4", 3), ("n", "<f4", 3), ("uv", "<u2", 2)])
    record["p"], record["n"], record["uv"] = TRIANGLE, (0, 0, 1), [(0, 0), (65535, 0), (0, 65535)]
    view = b.view(record.tobytes(), byteStride=28)
    uv = b.points(view, componentType=5123, type="VEC2", byteOffset=24, normalized=True)
    mesh = only_mesh(b.draw(b.points(view), NORMAL=b.points(view, byteOffset=12), TEXCOORD_0=uv).read())
    assert (mesh.positions == TRIANGLE).all()
    assert (mesh.normals == (0, 0, 1)).all()
    assert mesh.uv0.tolist() == [[0, 0], [1, 0], [0, 1]]


def test_unaligned_data_is_copied() -> None:
    b = Builder()
    data = b"\x01" + TRIANGLE.tobytes()
    view = b.add("bufferViews", {"buffer": b.buffer(data), "byteOffset": 1, "byteLength": 36})
    mesh = only_mesh(b.draw(b.points(view)).read())
    assert mesh.positions.flags.aligned
    assert (mesh.positions == TRIANGLE).all()


def sparse(b: Builder, indices: list[int], values: Any, *, base: bool = True, dtype: str = "H", count: int = 4) -> int:
    """The numbers from 0 on, or zeros, of which some positions are replaced."""
    rows = b.view(np.arange(3 * count, dtype=np.float32).tobytes()) if base else None
    given = {
        "count": len(indices),
        "indices": {"bufferView": b.view(np.array(indices, dtype).tobytes()), "componentType": COMPONENT[dtype]},
        "values": {"bufferView": b.view(np.array(values, np.float32).tobytes())},
    }
    return b.points(rows, count, sparse=given)


@pytest.mark.parametrize("dtype", ["B", "H", "I"])
def test_sparse_replaces_some_values(dtype: str) -> None:
    b = Builder()
    p = sparse(b, [1, 3], [(9, 9, 9), (8, 8, 8)], dtype=dtype)
    mesh = only_mesh(b.draw(p, [0, 1, 3]).read())
    assert mesh.positions.tolist() == [[0, 1, 2], [9, 9, 9], [6, 7, 8], [8, 8, 8]]


def test_sparse_without_a_base_starts_from_zeros() -> None:
    b = Builder()
    mesh = only_mesh(b.draw(sparse(b, [1, 2], [(1, 0, 0), (0, 1, 0)], base=False), [0, 1, 2]).read())
    assert mesh.positions[:3].tolist() == TRIANGLE.tolist()


def test_sparse_of_a_narrowed_range() -> None:
    """Only the range of vertices that is used is kept: sparse indices count from the accessor's start."""
    b = Builder()
    mesh = only_mesh(b.draw(sparse(b, [0, 3], [(7, 7, 7), (8, 8, 8)]), [2, 3], mode=1).read())
    assert mesh.positions.tolist() == [[6, 7, 8], [8, 8, 8]]
    assert mesh.elements.tolist() == [[0, 1]]


def test_invalid_sparse_parts_are_errors_except_from_drakes_merge() -> None:
    """The indices must be below the count."""

    def build(index: int, generator: str = "other") -> Builder:
        b = Builder(generator)
        return b.draw(sparse(b, [index], [(1, 1, 1)], base=False, count=3))

    assert meshes(build(2).read())[0].positions.tolist() == [[0, 0, 0], [0, 0, 0], [1, 1, 1]]
    with pytest.raises(GltfError, match=r"sparse\.indices: 3 .*\(3 "):
        build(3).read()
    scene = build(3, "Drake glTF merger").read()
    assert not meshes(scene)[0].positions.any()
    assert "accessors[0].sparse.indices" in scene.warnings[0]


def test_accessor_without_view_is_zeros() -> None:
    b = Builder()
    mesh = only_mesh(b.draw(TEXCOORD_0=b.points(None, type="VEC2")).read())
    assert mesh.uv0.tolist() == [[0, 0]] * 3


def broken(change: Any) -> Builder:
    b = Builder()
    primitive = {"attributes": {"POSITION": b.accessor(TRIANGLE)}, "indices": b.accessor([0, 1, 2], "H")}
    b.node(mesh=b.mesh(primitive | {"material": b.add("materials", {})}))
    change(b.json)
    return b


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda d: d["accessors"][0].update(bufferView=9),
            r"accessors\[0\]\.bufferView: 9 is out of range \(2 bufferViews\)",
        ),
        (lambda d: d["accessors"][0].update(count=4), r"accessors\[0\]: needs 48 bytes of bufferViews\[0\], .* has 36"),
        (lambda d: d["accessors"][0].update(count=0, byteOffset=2**70), rf"accessors\[0\]: needs {2**70} bytes of"),
        (lambda d: d["accessors"][0].update(count=10**15), r"accessors\[0\]\.count: 1000000000000000 is not between"),
        (lambda d: d["accessors"][0].update(count=-1), r"accessors\[0\]\.count: -1 is not"),
        (lambda d: d["accessors"][0].pop("count"), r"accessors\[0\]\.count: missing"),
        (lambda d: d["accessors"][0].update(byteOffset=-4), r"accessors\[0\]: needs 32 bytes"),
        (lambda d: d["accessors"][0].update(byteOffset=4), r"accessors\[0\]: needs 40 bytes"),
        (lambda d: d["accessors"][0].update(componentType=1), r"accessors\[0\]\.componentType: 1 is not a component"),
        (lambda d: d["accessors"][0].update(type="VEC9"), r"accessors\[0\]\.type: VEC9 is not one of SCALAR"),
        (lambda d: d["accessors"][0].update(type="SCALAR"), r"attributes\.POSITION: accessors\[0\] has 1 components"),
        (lambda d: d["accessors"][1].update(componentType=5126), r"needs 12 bytes of bufferViews\[1\], which has 6"),
        (
            lambda d: d["accessors"][1].update(type="VEC3", count=1),
            r"indices: accessors\[1\] is not an accessor of int",
        ),
        (lambda d: d["bufferViews"][0].update(byteStride=4), r"bufferViews\[0\]\.byteStride: 4 is not between 12"),
        (lambda d: d["bufferViews"][0].update(byteStride=-12), r"bufferViews\[0\]\.byteStride: -12 is not"),
        (lambda d: d["bufferViews"][0].update(byteOffset=1), r"bufferViews\[0\]: bytes 1 \.\. 37 are outside"),
        (lambda d: d["bufferViews"][0].update(byteLength=-1), r"bufferViews\[0\]: bytes 0 \.\. -1 are outside"),
        (lambda d: d["bufferViews"][0].pop("byteLength"), r"bufferViews\[0\]\.byteLength: missing"),
        (lambda d: d["bufferViews"][0].update(buffer=2), r"bufferViews\[0\]\.buffer: 2 is out of range \(2 buffers\)"),
        (lambda d: d["bufferViews"].__setitem__(0, None), r"accessors\[0\]\.bufferView: bufferViews\[0\] is null"),
        (lambda d: d["buffers"][0].pop("uri"), r"buffers\[0\]: there is neither a uri nor a binary chunk"),
        (
            lambda d: d["meshes"][0]["primitives"][0].update(indices=7),
            r"meshes\[0\]\.primitives\[0\]\.indices: 7 is out of range \(2 accessors\)",
        ),
        (lambda d: d["meshes"][0]["primitives"][0].update(mode=7), r"primitives\[0\]\.mode: 7 is not between 0 and 6"),
        (lambda d: d["nodes"][0].update(mesh=-1), r"nodes\[0\]\.mesh: -1 is out of range \(1 meshes\)"),
        (lambda d: d["accessors"][0].update(count=3.5), r"accessors\[0\]\.count: expected an integer, got 3\.5"),
    ],
)
def test_errors_name_the_element(change: Any, message: str) -> None:
    with pytest.raises(GltfError, match=message):
        broken(change).read()


def test_valid_document_is_read() -> None:
    assert len(meshes(broken(lambda d: None).read())) == 1
    assert len(meshes(broken(lambda d: d["accessors"][0].update(count=3.0)).read())) == 1


def test_large_counts_without_a_buffer_are_refused_before_allocation() -> None:
    b = Builder()
    with pytest.raises(GltfError, match="max_vertices = 20000000"):
        b.draw(b.points(None, 50_000_000)).read()


def test_many_meshes_of_one_buffer_are_limited() -> None:
    b = Builder()
    view = b.view(np.zeros(3000, np.float32).tobytes())
    for offset in range(50):
        b.draw(b.points(view, 900, byteOffset=4 * offset))
    assert len(meshes(b.read())) == 50
    with pytest.raises(GltfError, match=r"meshes\[10\]\..* max_vertices = 9000"):
        b.read(limits=GltfLimits(max_vertices=9000))
    with pytest.raises(GltfError, match=r"max_elements = 1000"):
        b.read(limits=GltfLimits(max_elements=1000))
    with pytest.raises(GltfError, match=r"max_mesh_bytes = 100000"):
        b.read(limits=GltfLimits(max_mesh_bytes=100_000))


def test_accessors_may_end_where_their_view_ends_and_views_where_their_buffer_ends() -> None:
    b = Builder()
    data = np.vstack((np.ones((1, 3)), TRIANGLE)).astype(np.float32).tobytes()
    buffer = b.buffer(b"\1" * 4 + data)
    view = b.add("bufferViews", {"buffer": buffer, "byteOffset": 4, "byteLength": len(data)})
    mesh = only_mesh(b.draw(b.points(view, byteOffset=12)).read())
    assert mesh.positions.tolist() == TRIANGLE.tolist()
    b.json["bufferViews"][view]["byteLength"] += 1
    with pytest.raises(GltfError, match=r"bufferViews\[0\]: .*4 \.\. 53 .*\(52 "):
        b.read()
    b.json["bufferViews"][view]["byteLength"] -= 2
    with pytest.raises(GltfError, match=r"accessors\[0\]: .*48 .*bufferViews\[0\].* 47"):
        b.read()


@pytest.mark.parametrize(("stride", "allowed"), [(8, False), (12, True), (16, True), (252, True), (256, False)])
def test_strides_are_at_least_a_value_and_at_most_252_bytes(stride: int, allowed: bool) -> None:
    b = Builder()
    rows = np.zeros((3, stride), np.uint8)
    rows[:, :8] = np.ascontiguousarray(TRIANGLE[:, :2]).view(np.uint8).reshape(3, 8)
    view = b.view(rows.tobytes() + bytes(12), byteStride=stride)
    b.draw(b.points(view))
    if allowed:
        assert only_mesh(b.read()).positions.tolist() == TRIANGLE.tolist()
    else:
        with pytest.raises(GltfError, match=rf"byteStride: {stride} is not between 12 and 252"):
            b.read()


@pytest.mark.parametrize("value", [-1e13, 3e38, -3e38])
def test_float64_values_that_fit_float32_are_kept_and_others_are_not_finite(value: float) -> None:
    b = Builder()
    p = b.accessor([(0, 0, 0), (0, value, 0), (1, 0, 0), (0, 0, 0), (0, 1, 0), (0, 0, 10 * value)], "d")
    mesh = only_mesh(b.draw(p).read())
    assert mesh.positions[1].tolist() == [0, np.float32(value), 0]
    assert len(mesh.elements) == (2 if value == -1e13 else 1)
