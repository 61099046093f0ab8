from typing import Any

import numpy as np
import pytest

from gateway.files.gltf import GltfError, GltfLimits
from tests.files.gltf.builder import COMPONENT, TRIANGLE, Builder, meshes, only_mesh


@pytest.mark.parametrize("dtype", ["B", "H", "I"])
def test_indices_of_every_type(dtype: str) -> None:
    b = Builder()
    positions = np.arange(12, dtype=np.float32).reshape(4, 3)
    mesh = only_mesh(
        {"attributes": {"POSITION": b.accessor(positions)}, "indices": b.accessor([0, 1, 2, 2, 1, 3], dtype)}, b
    )
    assert mesh.elements.dtype == np.uint32
    assert mesh.elements.tolist() == [[0, 1, 2], [2, 1, 3]]
    assert (mesh.positions == positions).all()


def test_arrays_are_read_only_contiguous_and_aligned() -> None:
    b = Builder()
    mesh = only_mesh(
        {
            "attributes": {
                "POSITION": b.accessor(TRIANGLE),
                "NORMAL": b.accessor(TRIANGLE),
                "TEXCOORD_0": b.accessor(TRIANGLE[:, :2]),
            }
        },
        b,
    )
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
    uv = np.column_stack([stored, stored])
    mesh = only_mesh(
        {"attributes": {"POSITION": b.accessor(TRIANGLE), "TEXCOORD_0": b.accessor(uv, dtype, normalized=True)}}, b
    )
    np.testing.assert_allclose(mesh.uv0[:, 0], expected, atol=1e-7)


@pytest.mark.parametrize("dtype", ["b", "B", "h", "H", "f", "d"])
def test_quantised_positions(dtype: str) -> None:
    b = Builder()
    mesh = only_mesh({"attributes": {"POSITION": b.accessor([(0, 0, 0), (100, 0, 0), (0, 100, 3)], dtype)}}, b)
    assert mesh.positions.dtype == np.float32
    assert mesh.positions.tolist() == [[0, 0, 0], [100, 0, 0], [0, 100, 3]]


def test_interleaved() -> None:
    b = Builder()
    record = np.zeros(3, dtype=[("p", "<f4", 3), ("n", "<f4", 3), ("uv", "<u2", 2)])
    record["p"], record["n"], record["uv"] = TRIANGLE, (0, 0, 1), [(0, 0), (65535, 0), (0, 65535)]
    view = b.view(record.tobytes(), byteStride=28)
    common = {"bufferView": view, "count": 3}
    p = b.add("accessors", {**common, "componentType": 5126, "type": "VEC3"})
    n = b.add("accessors", {**common, "componentType": 5126, "type": "VEC3", "byteOffset": 12})
    uv = b.add("accessors", {**common, "componentType": 5123, "type": "VEC2", "byteOffset": 24, "normalized": True})
    mesh = only_mesh({"attributes": {"POSITION": p, "NORMAL": n, "TEXCOORD_0": uv}}, b)
    assert (mesh.positions == TRIANGLE).all()
    assert mesh.normals is not None
    assert (mesh.normals == (0, 0, 1)).all()
    assert mesh.uv0.tolist() == [[0, 0], [1, 0], [0, 1]]


def test_unaligned_data_is_copied() -> None:
    b = Builder()
    data = b"\x01" + TRIANGLE.tobytes()
    view = b.add("bufferViews", {"buffer": b.buffer(data), "byteOffset": 1, "byteLength": 36})
    p = b.add("accessors", {"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"})
    mesh = only_mesh({"attributes": {"POSITION": p}}, b)
    assert mesh.positions.flags.aligned
    assert (mesh.positions == TRIANGLE).all()


def sparse(b: Builder, *, base: int | None, indices: list[int], values: Any, dtype: str = "H") -> int:
    accessor: dict[str, Any] = {"componentType": 5126, "count": 4, "type": "VEC3"}
    if base is not None:
        accessor["bufferView"] = base
    accessor["sparse"] = {
        "count": len(indices),
        "indices": {"bufferView": b.view(np.array(indices, dtype).tobytes()), "componentType": COMPONENT[dtype]},
        "values": {"bufferView": b.view(np.array(values, np.float32).tobytes())},
    }
    return b.add("accessors", accessor)


@pytest.mark.parametrize("dtype", ["B", "H", "I"])
def test_sparse_replaces_some_values(dtype: str) -> None:
    b = Builder()
    base = np.arange(12, dtype=np.float32).reshape(4, 3)
    p = sparse(b, base=b.view(base.tobytes()), indices=[1, 3], values=[(9, 9, 9), (8, 8, 8)], dtype=dtype)
    mesh = only_mesh({"attributes": {"POSITION": p}, "indices": b.accessor([0, 1, 3], "B")}, b)
    assert mesh.positions.tolist() == [[0, 1, 2], [9, 9, 9], [6, 7, 8], [8, 8, 8]]


def test_sparse_without_a_base_starts_from_zeros() -> None:
    b = Builder()
    p = sparse(b, base=None, indices=[1, 2], values=[(1, 0, 0), (0, 1, 0)])
    mesh = only_mesh({"attributes": {"POSITION": p}, "indices": b.accessor([0, 1, 2], "B")}, b)
    assert mesh.positions[:3].tolist() == TRIANGLE.tolist()


def test_sparse_of_a_narrowed_range() -> None:
    """Only the range of vertices that is used is kept: sparse indices count from the accessor's start."""
    b = Builder()
    base = np.arange(12, dtype=np.float32).reshape(4, 3)
    p = sparse(b, base=b.view(base.tobytes()), indices=[0, 3], values=[(7, 7, 7), (8, 8, 8)])
    mesh = only_mesh({"attributes": {"POSITION": p}, "indices": b.accessor([2, 3], "B"), "mode": 1}, b)
    assert mesh.positions.tolist() == [[6, 7, 8], [8, 8, 8]]
    assert mesh.elements.tolist() == [[0, 1]]


def test_invalid_sparse_parts_are_errors_except_from_drakes_merge() -> None:
    def build(generator: str) -> Builder:
        b = Builder(generator)
        p = sparse(b, base=b.view(np.zeros(12, "f").tobytes()), indices=[4], values=[(1, 1, 1)])
        b.node(mesh=b.mesh({"attributes": {"POSITION": p}, "indices": b.accessor([0, 1, 3], "B")}))
        return b

    with pytest.raises(GltfError, match=r"sparse\.indices: 4 .*\(4 "):
        build("other").read()
    scene = build("Drake glTF merger").read()
    assert not meshes(scene)[0].positions.any()
    assert "accessors[0].sparse.indices" in scene.warnings[0]


def test_accessor_without_view_is_zeros() -> None:
    b = Builder()
    uv = b.add("accessors", {"componentType": 5126, "count": 3, "type": "VEC2"})
    mesh = only_mesh({"attributes": {"POSITION": b.accessor(TRIANGLE), "TEXCOORD_0": uv}}, b)
    assert mesh.uv0.tolist() == [[0, 0]] * 3


def broken(change: Any) -> Builder:
    b = Builder()
    b.node(
        mesh=b.mesh(
            {"attributes": {"POSITION": b.accessor(TRIANGLE)}, "indices": b.accessor([0, 1, 2], "H"), "material": 0}
        )
    )
    b.add("materials", {})
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


def test_index_out_of_range_names_accessor_and_primitive() -> None:
    b = Builder()
    p, i = b.accessor(TRIANGLE), b.accessor([0, 1, 3], "H")
    b.node(mesh=b.mesh({"attributes": {"POSITION": p}, "indices": i}))
    expected = (
        r"meshes\[0\]\.primitives\[0\]\.indices: accessors\[1\] has the index 3, but accessors\[0\] has 3 vertices"
    )
    with pytest.raises(GltfError, match=expected):
        b.read()


def test_large_counts_without_a_buffer_are_refused_before_allocation() -> None:
    b = Builder()
    p = b.add("accessors", {"componentType": 5126, "count": 50_000_000, "type": "VEC3"})
    b.node(mesh=b.mesh({"attributes": {"POSITION": p}}))
    with pytest.raises(GltfError, match="max_vertices = 20000000"):
        b.read()


def test_many_meshes_of_one_buffer_are_limited() -> None:
    b = Builder()
    view = b.view(np.zeros(3000, np.float32).tobytes())
    for offset in range(50):
        p = b.add(
            "accessors",
            {"bufferView": view, "componentType": 5126, "count": 900, "type": "VEC3", "byteOffset": 4 * offset},
        )
        b.node(mesh=b.mesh({"attributes": {"POSITION": p}}))
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
    p = b.add("accessors", {"bufferView": view, "byteOffset": 12, "componentType": 5126, "count": 3, "type": "VEC3"})
    b.node(mesh=b.mesh({"attributes": {"POSITION": p}}))
    (mesh,) = meshes(b.read())
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
    p = b.add("accessors", {"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"})
    b.node(mesh=b.mesh({"attributes": {"POSITION": p}}))
    if allowed:
        (mesh,) = meshes(b.read())
        assert mesh.positions.tolist() == TRIANGLE.tolist()
    else:
        with pytest.raises(GltfError, match=rf"byteStride: {stride} is not between 12 and 252"):
            b.read()


def test_sparse_indices_are_below_the_count() -> None:
    def document(index: int) -> Builder:
        b = Builder()
        sparse = {
            "count": 1,
            "indices": {"bufferView": b.view(bytes((index,))), "componentType": 5121},
            "values": {"bufferView": b.view(np.full(3, 7, np.float32).tobytes())},
        }
        p = b.add("accessors", {"componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse})
        b.node(mesh=b.mesh({"attributes": {"POSITION": p}}))
        return b

    (mesh,) = meshes(document(2).read())
    assert mesh.positions.tolist() == [[0, 0, 0], [0, 0, 0], [7, 7, 7]]
    with pytest.raises(GltfError, match=r"sparse\.indices: 3 .*\(3 "):
        document(3).read()


@pytest.mark.parametrize("value", [-1e13, 3e38, -3e38])
def test_float64_values_that_fit_float32_are_kept_and_others_are_not_finite(value: float) -> None:
    b = Builder()
    p = b.accessor([(0, 0, 0), (0, value, 0), (1, 0, 0), (0, 0, 0), (0, 1, 0), (0, 0, 10 * value)], "d")
    b.node(mesh=b.mesh({"attributes": {"POSITION": p}}))
    (mesh,) = meshes(b.read())
    assert mesh.positions[1].tolist() == [0, np.float32(value), 0]
    assert len(mesh.elements) == (2 if value == -1e13 else 1)
