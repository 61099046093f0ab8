"""Messages ``ImageSet``, ``Image``, ``DisparityImage`` and ``Mesh`` of the stream, as chunks of protobuf wire format.

Protobuf would copy an image into a message object and from there into the serialised bytes, with the GIL held. Here
protobuf serialises the small fields only, and the large ``data`` fields are appended. The format permits any order of
fields, so the bytes parse to the same message.
"""

import ctypes
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND
from renderers.stereo.model import DISPARITY_SCALE, Intrinsics
from renderers.stereo.sensor.exposure import Exposure
from scenegate.camera import image_interface_pb2 as pb

Chunk = bytes | memoryview
"""Bytes. A view has one dimension and the format ``B``, so that ``len`` is its number of bytes."""
OUTPUT_MASK: Final = 0b0011
"""GPIO bits of Out1 and Out2."""
INPUT_MASK: Final = 0b1100
"""GPIO bits of In1 and In2."""
MIN_BYTES_WITHOUT_GIL: Final = 4 << 20
"""Number of bytes from which chunks are joined without the GIL. Fewer bytes take under half a millisecond. A full mesh
(55 MB) takes 65 ms, which would block the event loop."""

_LENGTH_DELIMITED: Final = 2
"""Wire type of bytes and messages."""

# The C API permits writing to a new bytes object before anything else refers to it; see ``join``.
_new_bytes = ctypes.pythonapi.PyBytes_FromStringAndSize
_new_bytes.restype = ctypes.py_object
_new_bytes.argtypes = (ctypes.c_void_p, ctypes.c_ssize_t)
_bytes_address = ctypes.pythonapi.PyBytes_AsString
_bytes_address.restype = ctypes.c_void_p
_bytes_address.argtypes = (ctypes.py_object,)


@dataclass(frozen=True, slots=True)
class ImageMetadata:
    """Time and exposure of an image."""

    timestamp: int
    """Middle of the exposure, nanoseconds since the epoch."""
    exposure: Exposure
    noise: float
    """Standard deviation of the noise, grey levels."""
    brightness: float
    """Mean of the image, 0 to 1; rounded to 0.01 in the message, as on the device."""
    gpio: int
    """GPIO values; see ``OUTPUT_MASK``."""
    out1_reduction: float = 0.0
    """Share by which images with Out1 low are exposed less, 0 to 1."""


def timestamp_field(nanoseconds: int) -> bytes:
    """Return a timestamp as field 1 of an ``ImageSet``."""
    data: bytes = pb.ImageSet(timestamp=time_message(nanoseconds)).SerializeToString()
    return data


def image(
    pixels: NDArray[np.uint8] | NDArray[np.uint16], intrinsics: Intrinsics, metadata: ImageMetadata
) -> list[Chunk]:
    """Return an ``Image`` that shares memory with ``pixels``: (H, W) uint8 or uint16, or (H, W, 3) uint8 RGB."""
    height, width = pixels.shape[:2]
    if pixels.dtype == np.uint16:
        encoding, step = "mono16", 2 * width
        pixels = np.ascontiguousarray(pixels, "<u2")
    else:
        channels = pixels.shape[2] if pixels.ndim == 3 else 1
        encoding, step = ("rgb8" if channels == 3 else "mono8"), channels * width
    header = pb.Image(
        timestamp=time_message(metadata.timestamp),
        height=height,
        width=width,
        focal_length=intrinsics.focal_length,
        principal_point_u=intrinsics.cx,
        principal_point_v=intrinsics.cy,
        encoding=encoding,
        is_bigendian=False,
        step=step,
        gpios=pb.Gpios(inputs=INPUT_MASK, outputs=OUTPUT_MASK, values=metadata.gpio),
        exposure_time=metadata.exposure.time,
        gain=metadata.exposure.gain,
        noise=metadata.noise,
        out1_reduction=metadata.out1_reduction,
        brightness=round(metadata.brightness, 2),
        gamma=metadata.exposure.gamma,
        auto_exposure_adapting=False,
    )
    data: Any = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8).data
    return [header.SerializeToString(), *field(10, [data])]


def disparity(image_chunks: list[Chunk], timestamp: int, baseline: float) -> list[Chunk]:
    """Return a ``DisparityImage`` of an ``Image`` of disparities. Timestamp in nanoseconds since the epoch, baseline in
    metres."""
    header = pb.DisparityImage(
        timestamp=time_message(timestamp),
        scale=DISPARITY_SCALE,
        offset=0.0,
        invalid_data_value=0.0,
        baseline=baseline,
        delta_d=DISPARITY_SCALE,
    )
    return [header.SerializeToString(), *field(7, image_chunks)]


def mesh(ply: tuple[Chunk, ...], timestamp: int) -> list[Chunk]:
    """Return a ``Mesh`` of the parts of a PLY file. The timestamp is in nanoseconds since the epoch."""
    header = pb.Mesh(timestamp=time_message(timestamp), format="ply")
    return [header.SerializeToString(), *field(3, list(ply))]


def depth_acquisition_done(imageset_timestamp: int, event_timestamp: int) -> bytes:
    """Return an ``ImageEvents``: all images for a depth image are captured. It is sent before depth is computed.

    Timestamps of the image set and of the end of the capture are in nanoseconds.
    """
    event = pb.ImageEvents(
        imageset_timestamp=time_message(imageset_timestamp),
        depth_acquisition_done=pb.Event(timestamp=time_message(event_timestamp)),
    )
    data: bytes = event.SerializeToString()
    return data


def time_message(nanoseconds: int) -> pb.Time:
    """Return a timestamp as a ``Time`` message."""
    sec, nsec = divmod(nanoseconds, NANOSECONDS_PER_SECOND)
    return pb.Time(sec=sec, nsec=nsec)


def varint(*values: int) -> bytes:
    """Return unsigned numbers in protobuf's base-128 encoding."""
    encoded = bytearray()
    for value in values:
        while value > 0x7F:
            encoded.append(value & 0x7F | 0x80)
            value >>= 7
        encoded.append(value)
    return bytes(encoded)


def byte_count(chunks: Sequence[Chunk]) -> int:
    """Return the number of bytes of all chunks."""
    return sum(map(len, chunks))


def field(number: int, chunks: Sequence[Chunk]) -> list[Chunk]:
    """Return a length-delimited field (bytes or a message) with the chunks as its content."""
    return [varint(number << 3 | _LENGTH_DELIMITED, sum(map(len, chunks))), *chunks]


def join(chunks: Sequence[Chunk]) -> bytes:
    """Return the chunks as one bytes object, copied without the GIL, for worker threads."""
    total = byte_count(chunks)
    data = cast(bytes, _new_bytes(None, total))
    target = np.ctypeslib.as_array((ctypes.c_uint8 * total).from_address(_bytes_address(data)))
    offset = 0
    for chunk in chunks:
        source = np.frombuffer(chunk, np.uint8)
        target[offset : offset + len(source)] = source
        offset += len(source)
    return data
