import hashlib
import io
import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gateway.runtime.state import part_codec as codec
from gateway.runtime.state.part_codec import PartDecoder, PartEncoder
from gateway.scene.tree.geometry import Part, PointCloud, Surface
from gateway.scene.tree.transforms import IDENTITY
from renderers.drawlist import Material, Mesh
from scenegate.messages.geometry import Box
from tests.runtime.state import trees


def round_trip(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    digest, blobs = PartEncoder().encode(parts)
    decoded: tuple[Part, ...] = PartDecoder(lambda digest: bytes(blobs[digest])).decode(digest)
    return decoded


@given(st.lists(trees.parts, max_size=3).map(tuple))
@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.too_slow])
def test_geometry_survives_the_round_trip(parts: tuple[Part, ...]) -> None:
    assert trees.described(round_trip(parts)) == trees.described(parts)


def test_names_of_shapes_in_stored_files_do_not_change() -> None:
    stored = {"Box", "Sphere", "Ellipsoid", "Cylinder", "Capsule", "Triad", "Surface", "PointCloud", "Line", "Light"}
    assert stored | {"Part"} <= set(codec.CLASSES)


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
    assert len(blobs) == 3, "the parts, the points and the material"


def test_rejects_arrays_of_objects() -> None:
    cloud = PointCloud(np.array([[object()]]))
    with pytest.raises(TypeError, match="with object cannot be stored"):
        PartEncoder().encode((Part(cloud, Material()),))


@pytest.mark.parametrize("value", [("os", {}), ("unknown",)])
def test_rejects_unknown_tags(value: tuple[object, ...]) -> None:
    class Pickler(pickle.Pickler):
        def persistent_id(self, each: object) -> object:
            return value if each is value else None

    output = io.BytesIO()
    Pickler(output).dump(value)
    with pytest.raises(Exception):  # noqa: B017, PT011 - whichever way it is found
        decode(output.getvalue())


def test_rejects_pickles_with_functions() -> None:
    with pytest.raises(ValueError, match=r"builtins\.print"):
        decode(pickle.dumps(print))


def test_rejects_changed_blobs() -> None:
    digest, blobs = PartEncoder().encode((Part(PointCloud(np.zeros((100, 3), np.float32)), Material()),))
    with pytest.raises(ValueError, match="does not match its digest"):
        PartDecoder(lambda each: bytes(len(blobs[each]) - 1) + b"!").decode(digest)


def decode(data: bytes) -> object:
    """Decode a blob."""
    return PartDecoder(lambda _: data).decode(hashlib.sha256(data).digest())


def test_material_bytes_do_not_depend_on_the_memo() -> None:
    writer, material = PartEncoder(), Material()
    first, _ = writer.encode((Part(Box((1.0, 2.0, 3.0)), material),))
    again_, _ = writer.encode((Part(Box((1.0, 2.0, 3.0)), material),))
    assert first == again_
