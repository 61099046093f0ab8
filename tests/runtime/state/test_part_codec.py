from __future__ import annotations

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.runtime.state import part_codec as codec
from gateway.runtime.state.part_codec import DamagedError, PartDecoder, PartEncoder
from gateway.scene.tree.geometry import Part, PointCloud, Shape, Surface
from gateway.scene.tree.transforms import IDENTITY
from renderers.drawlist import Image, Material, Mesh, Texture
from scenegate.messages.geometry import Box, Solid, Triad
from tests.runtime.state import trees
from tests.support.solids import TYPES, example


def round_trip(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    data, blobs = PartEncoder().encode(parts)
    return PartDecoder(lambda digest: bytes(blobs[digest])).decode(data)


@given(st.lists(trees.parts, max_size=3).map(tuple))
@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.too_slow])
def test_geometry_survives_the_round_trip(parts: tuple[Part, ...]) -> None:
    assert trees.described(round_trip(parts)) == trees.described(parts)


def test_texture_names_survive_the_round_trip() -> None:
    pixels = np.arange(4 * 7 * 5, dtype=np.uint8).reshape(7, 5, 4)
    material = Material(base_color_texture=Texture(Image(b"key", lambda: pixels), name="wood \ud800"))
    (part,) = round_trip((Part(Box((1.0, 2.0, 3.0)), material),))
    texture = part.material.base_color_texture
    assert texture is not None
    assert texture.name == "wood \ud800"
    np.testing.assert_array_equal(texture.image.decode(), pixels)


def test_names_of_shapes_in_stored_files_do_not_change() -> None:
    stored = {"Box", "Sphere", "Ellipsoid", "Cylinder", "Capsule", "Triad", "Surface", "PointCloud", "Line", "Part"}
    assert stored <= set(codec.CLASSES)


@pytest.mark.parametrize("solid", [example(solid) for solid in TYPES], ids=lambda solid: solid.kind)
def test_every_solid_type_survives_the_round_trip(solid: Solid) -> None:
    (part,) = round_trip((Part(solid, Material()),))
    assert part.shape == solid


@pytest.mark.parametrize(
    ("shape", "stored"),
    [
        (Box((1, 2, 3)), ["value", "Box", {"lengths": ["tuple", [1.0, 2.0, 3.0]]}]),
        (Triad(2, tube=True), ["value", "Triad", {"scale": 2.0, "tube": True}]),
    ],
)
def test_solids_are_stored_by_name_and_fields(shape: Shape, stored: list[object]) -> None:
    data, _ = PartEncoder().encode((Part(shape, Material()),))
    assert msgspec.msgpack.decode(data)[0][2]["shape"] == stored


def test_shared_objects_are_shared_after_decoding() -> None:
    material, mesh = Material(), Mesh(np.zeros((99, 3), np.float32), np.zeros((33, 3), np.uint32))
    one, two = round_trip((Part(Surface(mesh), material), Part(Surface(mesh), material)))
    assert one.material is two.material
    assert isinstance(one.shape, Surface)
    assert isinstance(two.shape, Surface)
    assert one.shape.mesh is two.shape.mesh
    assert one.X_node_part is IDENTITY


def test_equal_arrays_share_a_blob() -> None:
    clouds = [PointCloud(np.full((100, 3), 7, np.float32)) for _ in range(2)]
    _, blobs = PartEncoder().encode(tuple(Part(cloud, Material()) for cloud in clouds))
    assert len(blobs) == 1


def test_rejects_arrays_of_objects() -> None:
    cloud = PointCloud(np.array([[object()]]))
    with pytest.raises(TypeError, match="array of object cannot be stored"):
        PartEncoder().encode((Part(cloud, Material()),))


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xc1",
        b"\x91\x01",
        b"\x91\x92\xa5value\xa3Box",
        b"\x91\x92\xa6nobody\x01",
        b"\x91\x93\xa5value\xa2os\x80",
        b"\x91\x94\xa5array\xa3|O8\x91\x01\xc4\x0800000000",
        b"\x91\x94\xa5array\xa3<f8\x91\x02\xc4\x0800000000",
        b"\x91\x94\xa4blob\xa3<f8\x91\x01\xc4\x0800000000",
    ],
)
def test_rejects_damaged_bytes(data: bytes) -> None:
    def missing(digest: bytes) -> bytes:
        raise KeyError(digest)

    with pytest.raises(DamagedError):
        PartDecoder(missing).decode(data)


def test_rejects_changed_blobs() -> None:
    data, blobs = PartEncoder().encode((Part(PointCloud(np.zeros((100, 3), np.float32)), Material()),))
    with pytest.raises(DamagedError, match="does not match its digest"):
        PartDecoder(lambda digest: bytes(len(blobs[digest]) - 1) + b"!").decode(data)


def test_material_bytes_do_not_depend_on_the_memo() -> None:
    writer, material = PartEncoder(), Material()
    first, _ = writer.encode((Part(Box((1.0, 2.0, 3.0)), material),))
    again_, _ = writer.encode((Part(Box((1.0, 2.0, 3.0)), material),))
    assert first == again_
