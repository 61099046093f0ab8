"""KHR_draco_mesh_compression: files written by glTF-Transform, and meshes encoded by DracoPy."""

import base64
from pathlib import Path
from typing import Any

import DracoPy
import numpy as np
import pytest

from gateway.files.gltf import GltfError, GltfLimits
from gateway.files.gltf.draco import decode_in_child
from renderers.stop import StopFlag
from tests.files.gltf.builder import Builder, corners, meshes, read_file, world_triangles

POSITIONS = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0.5)], np.float32)
TRIANGLES = np.array([(0, 1, 2), (1, 3, 2)], np.uint32)
NAME = r"meshes\[0\]\.primitives\[0\]\.extensions\.KHR_draco_mesh_compression"


def encoded(**options: Any) -> bytes:
    data: bytes = DracoPy.encode(POSITIONS, TRIANGLES, **{"preserve_order": True, "quantization_bits": 16} | options)
    return data


def document(data: bytes, attributes: dict[str, int] | None = None, **extension: Any) -> Builder:
    """Two triangles whose accessors have no buffer view."""
    b = Builder()
    accessors = {"POSITION": b.points(None, 4)}
    if "COLOR_0" in (attributes or {}):
        accessors["COLOR_0"] = b.points(None, 4, componentType=5121, normalized=True, type="VEC4")
    indices = b.points(None, 6, componentType=5123, type="SCALAR")
    source = {"bufferView": b.view(data), "attributes": attributes or {"POSITION": 0}} | extension
    extensions = {"KHR_draco_mesh_compression": source}
    b.node(mesh=b.mesh({"attributes": accessors, "indices": indices, "extensions": extensions}))
    return b


@pytest.mark.parametrize("name", ["rigid_draco_edgebreaker", "rigid_draco_sequential"])
def test_files_equal_those_without_compression(name: str) -> None:
    (ours,), (expected,) = world_triangles(read_file(name)), world_triangles(read_file("rigid"))
    assert ours.shape == expected.shape
    by_center = [np.lexsort(np.round(triangles.mean(axis=1), 2).T) for triangles in (ours, expected)]
    centers = [triangles.mean(axis=1)[order] for triangles, order in zip((ours, expected), by_center, strict=True)]
    assert np.abs(centers[0] - centers[1]).max() < 1e-3  # quantized to 14 bits
    (mesh,) = meshes(read_file(name))
    assert mesh.uv0 is not None
    outward = mesh.positions[:, (0, 2)] / np.linalg.norm(mesh.positions[:, (0, 2)], axis=1)[:, None]
    assert (np.einsum("ij,ij->i", outward, mesh.normals[:, (0, 2)]) > 0.99).all()


def test_joints_and_weights_are_decompressed() -> None:
    b = read_file("skinned_draco")
    (ours,) = world_triangles(b)
    (rigid,) = world_triangles(read_file("rigid"))
    assert ours.shape == rigid.shape
    tip = ours[..., 1].max()
    assert ours[..., 0].min() < -0.8  # bent to the left
    assert tip < 2.0


@pytest.mark.parametrize("level", [0, 5, 10])
@pytest.mark.parametrize("metadata", [False, True])
def test_encodings(level: int, metadata: bool) -> None:
    data = encoded(compression_level=level, create_metadata=metadata)
    (mesh,) = meshes(document(data).read())
    assert np.abs(corners(mesh) - POSITIONS[TRIANGLES]).max() < 1e-4


def test_normalized_integers() -> None:
    colors = np.array([(255, 0, 0, 255), (0, 255, 0, 255), (0, 0, 51, 255), (0, 0, 0, 0)], np.uint8)
    data = encoded(colors=colors)
    ids = {each["attribute_type"]: each["unique_id"] for each in DracoPy.decode(data).attributes}
    (mesh,) = meshes(document(data, {"POSITION": ids[0], "COLOR_0": ids[2]}).read())
    assert np.abs(mesh.colors - colors / np.float32(255)).max() < 1e-6


def test_stored_values_are_read_where_there_are_both() -> None:
    b = document(b"not Draco")
    b.json["accessors"][0]["bufferView"] = b.view((POSITIONS + 5).tobytes())
    b.json["accessors"][1]["bufferView"] = b.view(TRIANGLES.astype(np.uint16).tobytes())
    (mesh,) = meshes(b.read())
    assert (corners(mesh) == POSITIONS[TRIANGLES] + 5).all()


def test_broken_data_leaves_what_is_stored_beside_it() -> None:
    b = document(b"not Draco", {"POSITION": 0, "COLOR_0": 1})
    b.json["accessors"][0]["bufferView"] = b.view(POSITIONS.tobytes())
    b.json["accessors"][2]["bufferView"] = b.view(TRIANGLES.astype(np.uint16).tobytes())
    scene = b.read()
    (mesh,) = meshes(scene)
    assert (corners(mesh) == POSITIONS[TRIANGLES]).all()
    assert mesh.colors is None
    (warning,) = scene.warnings
    assert "KHR_draco_mesh_compression: " in warning
    assert warning.endswith("; the uncompressed copy is drawn, which has no COLOR_0")


def test_data_is_read_where_the_stored_copy_has_no_indices() -> None:
    b = document(encoded())
    b.json["accessors"][0]["bufferView"] = b.view(POSITIONS.tobytes())
    (mesh,) = meshes(b.read())
    assert np.abs(corners(mesh) - POSITIONS[TRIANGLES]).max() < 1e-4


def test_the_mode_of_strips_does_not_apply_to_decompressed_triangles() -> None:
    b = document(encoded())
    b.json["meshes"][0]["primitives"][0]["mode"] = 5
    (mesh,) = meshes(b.read())
    assert len(mesh.elements) == 2


@pytest.mark.parametrize(
    ("attributes", "extension", "message"),
    [
        (None, {"bufferView": None}, r"\.bufferView: missing"),
        (None, {"bufferView": 3}, r"\.bufferView: 3 is out of range \(1 bufferViews\)"),
        (None, {"bufferView": "0"}, r"\.bufferView: expected an integer, got \"0\""),
        ({"POSITION": 9}, {}, r"\.attributes\.POSITION: the mesh has no attribute with the id 9"),
        ({"POSITION": 0, "COLOR_0": 0}, {}, r"\.attributes\.COLOR_0: 3 components, but its accessor has 4"),
        ({"NORMAL": 0}, {}, r"\.attributes\.POSITION: missing"),
    ],
)
def test_errors_name_the_property(attributes: Any, extension: Any, message: str) -> None:
    with pytest.raises(GltfError, match=NAME + message):
        document(encoded(), attributes, **extension).read()


@pytest.mark.parametrize(("accessor", "count"), [(0, 3), (0, 5), (1, 3), (1, 9)])
def test_the_compressed_mesh_says_how_much_there_is(accessor: int, count: int) -> None:
    """Files of old exporters, such as a CesiumMilkTruck, have the counts of before the compression."""
    b = document(encoded())
    b.json["accessors"][accessor]["count"] = count
    (mesh,) = meshes(b.read())
    assert (len(mesh.positions), len(mesh.elements)) == (4, 2)


def test_stored_attributes_too_short_for_the_compressed_vertices_are_ignored() -> None:
    b = document(encoded())
    b.json["accessors"][0]["count"] = 3
    uv = b.accessor([(0, 0), (1, 0), (0, 1)])
    b.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = uv
    scene = b.read()
    (mesh,) = meshes(scene)
    assert mesh.uv0 is None
    path = r"meshes[0].primitives[0].attributes.TEXCOORD_0"
    assert scene.warnings == (f"{path}: accessors[{uv}] has 3 values for 4 vertices; {path} is ignored",)


def test_memory_is_limited() -> None:
    """427 bytes that stand for a million vertices with 508 numbers each."""
    b = document((Path(__file__).parent / "files" / "million_vertices.drc").read_bytes())
    b.json["accessors"][0]["count"] = 1_000_000
    b.json["accessors"][1]["count"] = 3
    with pytest.raises(GltfError, match=NAME + ": .*(memory|bad_alloc)"):
        b.read(limits=GltfLimits(max_draco_bytes=600 << 20))


def test_the_size_of_all_meshes_is_limited() -> None:
    with pytest.raises(GltfError, match="larger than max_mesh_bytes"):
        document(encoded()).read(limits=GltfLimits(max_mesh_bytes=40))


def test_the_deadline_ends_the_decoder() -> None:
    flag = StopFlag()
    flag.set(TimeoutError("late"))
    with pytest.raises(TimeoutError, match="late"):
        flag.run(lambda: decode_in_child([encoded()], GltfLimits()))


def test_a_mesh_larger_than_a_pipe() -> None:
    rng = np.random.default_rng(1)
    positions, triangles = rng.random((60_000, 3)).astype(np.float32), np.arange(60_000, dtype=np.uint32).reshape(-1, 3)
    data = DracoPy.encode(positions, triangles, preserve_order=True, quantization_bits=16)
    assert len(data) > 200_000
    b = document(data)
    b.json["accessors"][0]["count"] = b.json["accessors"][1]["count"] = 60_000
    (mesh,) = meshes(b.read())
    assert np.abs(mesh.positions - positions).max() < 1e-4


def test_a_primitive_is_not_affected_by_damage_to_another() -> None:
    b = document(encoded())
    damaged = b.view(encoded()[:-20])
    primitive = b.json["meshes"][0]["primitives"][0]
    extension = {"KHR_draco_mesh_compression": {"bufferView": damaged, "attributes": {"POSITION": 0}}}
    b.mesh(primitive | {"extensions": extension})  # not in the scene
    assert b.read().instance_count == 1
    b.json["nodes"][0]["mesh"] = 1
    with pytest.raises(GltfError, match=r"meshes\[1\]\.primitives\[0\]\.extensions\.KHR_draco_mesh_compression: "):
        b.read()


@pytest.mark.parametrize(
    ("data", "change", "message"),
    [
        *((data, {}, "") for data in (b"", b"DRACO", b"DRACO\2\2\1\0\0\0\0\4", encoded()[:40])),
        (DracoPy.encode(POSITIONS), {}, ": there are no triangles"),
        (encoded(), {"indices": None}, ": the primitive has no indices"),
        (encoded(), {"generator": "Drake glTF merger"}, ": Drake's merge does not adapt"),
    ],
)
def test_what_cannot_be_decompressed(data: bytes, change: dict[str, Any], message: str) -> None:
    b = document(data)
    b.json["asset"] |= change
    b.json["meshes"][0]["primitives"][0] |= change
    with pytest.raises(GltfError, match=NAME + message):
        b.read()


@pytest.mark.parametrize("level", [0, 10])
def test_damaged_data_ends_with_an_error_or_a_mesh(level: int) -> None:
    data = encoded(compression_level=level, create_metadata=level == 10)
    rng = np.random.default_rng(level)
    b = Builder()
    for _ in range(300):
        damaged = bytearray(data[: rng.integers(len(data))] if rng.random() < 0.2 else data)
        if damaged:
            damaged[rng.integers(len(damaged))] = rng.integers(256)
        b.view(bytes(damaged))
    views = [base64.b64decode(each["uri"].partition(",")[2]) for each in b.json["buffers"]]
    results = decode_in_child(views, GltfLimits())
    assert len(results) == len(views)
    assert len({result for result in results if isinstance(result, str)}) >= 1


def test_a_missing_decoder_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gateway.files.gltf.draco.find_spec", lambda name: None)
    (reason,) = decode_in_child([encoded()], GltfLimits())
    assert isinstance(reason, str)
    assert "scenegate[draco]" in reason
