from __future__ import annotations

from typing import get_args

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.scene.geometry import Box, Part, PointCloud, Shape, Surface
from gateway.scene.transforms import IDENTITY
from gateway.state import parts as codec
from gateway.state.parts import DamagedError, PartsReader, PartsWriter
from renderers.drawlist import Image, Material, Mesh, Texture
from tests.state import trees


def again(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    data, blobs = PartsWriter().encode(parts)
    return PartsReader(lambda digest: bytes(blobs[digest])).decode(data)


@given(st.lists(trees.parts, max_size=3).map(tuple))
@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.too_slow])
def test_geometry_comes_back_exactly(parts: tuple[Part, ...]) -> None:
    assert trees.described(again(parts)) == trees.described(parts)


def test_names_of_pictures_come_back() -> None:
    pixels = np.arange(4 * 7 * 5, dtype=np.uint8).reshape(7, 5, 4)
    material = Material(base_color_texture=Texture(Image(b"key", lambda: pixels), name="wood \ud800"))
    (part,) = again((Part(Box((1.0, 2.0, 3.0)), material),))
    texture = part.material.base_color_texture
    assert texture is not None
    assert texture.name == "wood \ud800"
    np.testing.assert_array_equal(texture.image.decode(), pixels)


def test_every_shape_is_known() -> None:
    assert set(get_args(Shape)) <= set(codec._VALUES.values())


def test_what_was_shared_is_shared_again() -> None:
    material, mesh = Material(), Mesh(np.zeros((99, 3), np.float32), np.zeros((33, 3), np.uint32))
    one, two = again((Part(Surface(mesh), material), Part(Surface(mesh), material)))
    assert one.material is two.material
    assert isinstance(one.shape, Surface)
    assert isinstance(two.shape, Surface)
    assert one.shape.mesh is two.shape.mesh
    assert one.X_node_part is IDENTITY


def test_equal_arrays_are_one_blob() -> None:
    clouds = [PointCloud(np.full((100, 3), 7, np.float32)) for _ in range(2)]
    _, blobs = PartsWriter().encode(tuple(Part(cloud, Material()) for cloud in clouds))
    assert len(blobs) == 1


def test_arrays_of_objects_are_not_stored() -> None:
    cloud = PointCloud(np.array([[object()]]))
    with pytest.raises(TypeError, match="array of object cannot be stored"):
        PartsWriter().encode((Part(cloud, Material()),))


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
def test_damage_is_told(data: bytes) -> None:
    def missing(digest: bytes) -> bytes:
        raise KeyError(digest)

    with pytest.raises(DamagedError):
        PartsReader(missing).decode(data)


def test_a_changed_blob_is_noticed() -> None:
    data, blobs = PartsWriter().encode((Part(PointCloud(np.zeros((100, 3), np.float32)), Material()),))
    with pytest.raises(DamagedError, match="not what its digest says"):
        PartsReader(lambda digest: bytes(len(blobs[digest]) - 1) + b"!").decode(data)


def test_the_same_material_is_encoded_once() -> None:
    writer, material = PartsWriter(), Material()
    first, _ = writer.encode((Part(Box((1.0, 2.0, 3.0)), material),))
    again_, _ = writer.encode((Part(Box((1.0, 2.0, 3.0)), material),))
    assert first == again_
