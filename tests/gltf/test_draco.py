"""KHR_draco_mesh_compression: files written by glTF-Transform, and meshes encoded by DracoPy."""

from __future__ import annotations

from typing import Any

import DracoPy
import numpy as np
import pytest

from gateway.gltf import GltfError, GltfLimits
from gateway.gltf.draco_header import DracoError, element_counts
from tests.gltf.builder import Builder, corners, meshes, read_file, world_triangles

POSITIONS = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0.5)], np.float32)
TRIANGLES = np.array([(0, 1, 2), (1, 3, 2)], np.uint32)
NAME = r"meshes\[0\]\.primitives\[0\]\.extensions\.KHR_draco_mesh_compression"


def encoded(**options: Any) -> bytes:
    data: bytes = DracoPy.encode(POSITIONS, TRIANGLES, **{"preserve_order": True, "quantization_bits": 16} | options)
    return data


def document(data: bytes, attributes: dict[str, int] | None = None, **extension: Any) -> Builder:
    """Two triangles whose accessors have no buffer view."""
    b = Builder()
    accessors = {"POSITION": b.add("accessors", {"componentType": 5126, "count": 4, "type": "VEC3"})}
    if "COLOR_0" in (attributes or {}):
        color = {"componentType": 5121, "count": 4, "normalized": True, "type": "VEC4"}
        accessors["COLOR_0"] = b.add("accessors", color)
    indices = b.add("accessors", {"componentType": 5123, "count": 6, "type": "SCALAR"})
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
    assert mesh.normals is not None
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
    assert element_counts(data) == (4, 2)
    (mesh,) = meshes(document(data).read())
    assert np.abs(corners(mesh) - POSITIONS[TRIANGLES]).max() < 1e-4


def test_normalized_integers() -> None:
    colors = np.array([(255, 0, 0, 255), (0, 255, 0, 255), (0, 0, 51, 255), (0, 0, 0, 0)], np.uint8)
    data = encoded(colors=colors)
    ids = {each["attribute_type"]: each["unique_id"] for each in DracoPy.decode(data).attributes}
    (mesh,) = meshes(document(data, {"POSITION": ids[0], "COLOR_0": ids[2]}).read())
    assert mesh.colors is not None
    assert np.abs(mesh.colors - colors / np.float32(255)).max() < 1e-6


def test_stored_values_are_read_where_there_are_both() -> None:
    b = document(b"not Draco")
    b.json["accessors"][0]["bufferView"] = b.view((POSITIONS + 5).tobytes())
    b.json["accessors"][1]["bufferView"] = b.view(TRIANGLES.astype(np.uint16).tobytes())
    (mesh,) = meshes(b.read())
    assert (corners(mesh) == POSITIONS[TRIANGLES] + 5).all()


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
        (None, {"bufferView": "0"}, r": Expected `int \| null`, got `str`"),
        ({"POSITION": 9}, {}, r"\.attributes\.POSITION: the mesh has no attribute with the id 9"),
        ({"POSITION": 0, "COLOR_0": 0}, {}, r"\.attributes\.COLOR_0: 4 x 3 values instead of 4 x 4"),
        ({"NORMAL": 0}, {}, r"\.attributes\.POSITION: missing"),
    ],
)
def test_errors_name_the_property(attributes: Any, extension: Any, message: str) -> None:
    with pytest.raises(GltfError, match=NAME + message):
        document(encoded(), attributes, **extension).read()


@pytest.mark.parametrize(
    ("accessor", "count", "message"),
    [
        (0, 3, ": 4 vertices and 2 triangles, but the accessors have 3 and 2"),
        (1, 5, ": 4 vertices and 2 triangles, but the accessors have 4 and 1"),
        (0, 5, r"\.attributes\.POSITION: 4 x 3 values instead of 5 x 3"),
    ],
)
def test_accessors_say_how_much_is_decompressed(accessor: int, count: int, message: str) -> None:
    b = document(encoded())
    b.json["accessors"][accessor]["count"] = count
    with pytest.raises(GltfError, match=NAME + message):
        b.read()


def test_limit() -> None:
    b = document(encoded())
    assert b.read(limits=GltfLimits(max_compressed_vertices=4)).instance_count == 1
    with pytest.raises(GltfError, match=NAME + ": 4 vertices are more than max_compressed_vertices = 3"):
        b.read(limits=GltfLimits(max_compressed_vertices=3))


def test_indices_are_needed() -> None:
    b = document(encoded())
    del b.json["meshes"][0]["primitives"][0]["indices"]
    with pytest.raises(GltfError, match=NAME + ": the primitive has no indices"):
        b.read()


def test_drakes_merge_loses_the_buffer_view() -> None:
    b = document(encoded())
    b.json["asset"]["generator"] = "Drake glTF merger"
    with pytest.raises(GltfError, match=NAME + ": Drake's merge does not adapt"):
        b.read()


@pytest.mark.parametrize(
    "data",
    [b"", b"DRACO", b"DRACO\2\1\1\0\0\0\2\4", b"DRACO\2\2\0\0\0\0\2\4", b"DRACO\2\2\1\0\0\0\xff\xff\xff\xff\xff\1"],
)
def test_headers_that_cannot_be_read(data: bytes) -> None:
    with pytest.raises(DracoError):
        element_counts(data)


def test_metadata_nested_too_deeply() -> None:
    level = b"\0\1\0"  # no entries, one child with an empty name
    with pytest.raises(DracoError, match="nested too deeply"):
        element_counts(b"DRACO\2\2\1\0\0\x80\0" + level * 100)


@pytest.mark.parametrize("level", [0, 10])
def test_damaged_data_ends_with_an_error_or_a_mesh(level: int) -> None:
    data = encoded(compression_level=level, create_metadata=level == 10)
    rng = np.random.default_rng(level)
    messages = set()
    for _ in range(300):
        damaged = bytearray(data[: rng.integers(len(data))] if rng.random() < 0.2 else data)
        if damaged:
            damaged[rng.integers(len(damaged))] = rng.integers(256)
        try:
            document(bytes(damaged)).read()
        except GltfError as error:
            messages.add(str(error))
    assert len(messages) > 3
