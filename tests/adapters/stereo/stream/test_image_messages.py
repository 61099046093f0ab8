"""Kinds of requests, and serialised messages against protobuf."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.stream import image_messages as messages
from gateway.adapters.stereo.stream.image_messages import ImageMetadata
from gateway.adapters.stereo.stream.set_kind import ImageRequestError, SetKind, read_set_kind
from renderers.stereo.model import Intrinsics
from renderers.stereo.sensor.exposure import Exposure
from scenegate.camera import image_interface_pb2 as pb

METADATA = ImageMetadata(1_700_000_000_040_000_001, Exposure(0.01, 3.0, 1.5), noise=0.4, brightness=0.456, gpio=1)


@pytest.mark.parametrize("shape", [(2, 3), (2, 3, 3), (2400, 2000)])
def test_images_parse_to_their_fields(shape: tuple[int, ...]) -> None:
    pixels = np.random.default_rng(0).integers(0, 255, shape, np.uint8)
    k = Intrinsics(shape[1], shape[0], 100.5, 1.5, 1.0)
    chunks = [messages.timestamp_field(METADATA.timestamp), *messages.field(2, messages.image(pixels, k, METADATA))]
    data = messages.join(chunks)
    assert len(data) == messages.byte_count(chunks)
    time = pb.Time(sec=1_700_000_000, nsec=40_000_001)
    size = {"height": shape[0], "width": shape[1], "step": shape[1] * (3 if len(shape) == 3 else 1)}
    lens = {"focal_length": 100.5, "principal_point_u": 1.5, "principal_point_v": 1.0}
    measured = {"exposure_time": 0.01, "gain": 3.0, "noise": 0.4, "brightness": 0.46, "gamma": 1.5}
    gpios, encoding = pb.Gpios(inputs=12, outputs=3, values=1), "rgb8" if len(shape) == 3 else "mono8"
    fields: Any = {**size, **lens, **measured, "encoding": encoding, "data": pixels.tobytes()}
    expected = pb.Image(timestamp=time, gpios=gpios, **fields)
    assert pb.ImageSet.FromString(data) == pb.ImageSet(timestamp=time, left=expected)


def test_disparity_is_little_endian() -> None:
    values = np.array([[1, 256]], ">u2").astype(np.uint16)
    image = pb.Image.FromString(messages.join(messages.image(values, Intrinsics(2, 1, 1, 1, 0.5), METADATA)))
    assert (image.encoding, image.step, image.data) == ("mono16", 4, b"\x01\x00\x00\x01")


def test_meshes_and_disparities_are_wrapped() -> None:
    inner = messages.image(np.zeros((1, 1), np.uint16), Intrinsics(1, 1, 1, 0.5, 0.5), METADATA)
    chunks = [
        *messages.field(4, messages.disparity(inner, 5, 0.16)),
        *messages.field(7, messages.mesh((b"ab", memoryview(b"cd")), 6)),
    ]
    image_set = pb.ImageSet.FromString(messages.join(chunks))
    assert image_set.mesh == pb.Mesh(timestamp=pb.Time(nsec=6), format="ply", data=b"abcd")
    assert image_set.disparity.timestamp.nsec == 5
    assert image_set.disparity.baseline == pytest.approx(0.16)
    assert image_set.disparity.image.width == 1


FIELDS = ("left_enabled", "right_enabled", "disparity_enabled", "disparity_error_enabled", "confidence_enabled")
requests = st.builds(
    pb.ImageSetRequest,
    **dict.fromkeys((*FIELDS, "mesh_enabled", "color"), st.booleans()),
    mesh_options=st.none()
    | st.builds(
        pb.MeshOptions,
        max_points=st.integers(0, 2**32 - 1) | st.integers(0, 2000),
        binning_method=st.integers(0, 3),
        watertight=st.booleans(),
        textured=st.booleans(),
    ),
)


@given(requests)
def test_any_request_is_a_kind_or_rejected(request: pb.ImageSetRequest) -> None:
    options = request.mesh_options
    wrong = request.mesh_enabled and (0 < options.max_points < 1000 or options.binning_method > 1)
    try:
        kind = read_set_kind(request, StereoConfig())
    except ImageRequestError as error:
        assert wrong
        assert "mesh_options." in str(error)
        return
    assert not wrong
    names = ("left", "right", "disparity", "error", "confidence")
    assert [getattr(kind, n) for n in names] == [getattr(request, f) for f in FIELDS]
    assert (kind.mesh is not None) == request.mesh_enabled
    assert kind.has_depth == any(getattr(request, f) for f in (*FIELDS[2:], "mesh_enabled"))
    assert str(kind)


def test_equivalent_requests_are_one_kind() -> None:
    # Mesh options without a mesh, and colour without images, are ignored.
    request = pb.ImageSetRequest(disparity_enabled=True, color=True)
    assert read_set_kind(request, StereoConfig()) == SetKind(disparity=True)
    request = pb.ImageSetRequest(left_enabled=True, mesh_options=pb.MeshOptions(max_points=1), depth_aligned=True)
    assert read_set_kind(request, StereoConfig()) == SetKind(left=True)


@pytest.mark.parametrize("value", [1, 127, 128, 129, 255, 256, 16_383, 16_384, 16_385, 2**31, 2**32 - 1])
def test_numbers_are_protobufs(value: int) -> None:
    assert messages.varint(value) == pb.Gpios(inputs=value).SerializeToString()[1:]


@pytest.mark.parametrize("extra", [-1, 0, 1])
def test_chunks_are_joined_in_order_at_any_size(extra: int) -> None:
    large = np.arange(messages.MIN_BYTES_WITHOUT_GIL + extra - 6, dtype=np.uint32).astype(np.uint8).tobytes()
    assert messages.join([b"abc", memoryview(large), b"def"]) == b"abc" + large + b"def"
