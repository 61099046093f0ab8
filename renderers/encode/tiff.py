"""TIFF 6.0 encoder, baseline layout: little endian, one directory, one strip, no compression."""

import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

_SHORT: Final = 3
"""Field type (TIFF 6.0, section 2)."""
_LONG: Final = 4
"""Field type."""
_UINT: Final = 1
"""SampleFormat (section 19)."""
_IEEE_FLOAT: Final = 3
"""SampleFormat."""
_TAGS: Final = 10
_DATA_OFFSET: Final = 136
"""Header (8 bytes) and directory (2 + 10 * 12 + 4 bytes), padded to 8 bytes so that samples can be memory-mapped."""


def tiff_float32(image: NDArray[np.float32]) -> bytes:
    """Return a 32-bit float TIFF of an (H, W) float32 image; inf and NaN are kept."""
    if image.dtype != np.float32:
        raise ValueError(f"expected (H, W) float32, got {image.shape} {image.dtype.name}")
    return _tiff(image, "<f4", 32, _IEEE_FLOAT)


def tiff_gray16(image: NDArray[np.uint16]) -> bytes:
    """Return a 16-bit unsigned TIFF of an (H, W) uint16 image."""
    if image.dtype != np.uint16:
        raise ValueError(f"expected (H, W) uint16, got {image.shape} {image.dtype.name}")
    return _tiff(image, "<u2", 16, _UINT)


def _tiff(image: NDArray[np.generic], dtype: str, bits: int, sample_format: int) -> bytes:
    if image.ndim != 2 or image.size == 0:
        raise ValueError(f"expected (H, W) with at least one pixel, got {image.shape}")
    samples = np.ascontiguousarray(image).astype(dtype, copy=False)
    height, width = samples.shape
    if samples.nbytes + _DATA_OFFSET >= 1 << 32:
        raise ValueError(f"{width}x{height} samples exceed the 4 GiB of a TIFF file")
    entries = (
        (256, _LONG, width),  # ImageWidth
        (257, _LONG, height),  # ImageLength
        (258, _SHORT, bits),  # BitsPerSample
        (259, _SHORT, 1),  # Compression: none
        (262, _SHORT, 1),  # PhotometricInterpretation: BlackIsZero
        (273, _LONG, _DATA_OFFSET),  # StripOffsets
        (277, _SHORT, 1),  # SamplesPerPixel
        (278, _LONG, height),  # RowsPerStrip: all of them
        (279, _LONG, samples.nbytes),  # StripByteCounts
        (339, _SHORT, sample_format),  # SampleFormat
    )
    assert len(entries) == _TAGS
    head = struct.pack("<2sHIH", b"II", 42, 8, _TAGS)
    # A SHORT is left-justified in the 4-byte value field: in little endian the same bytes as a LONG.
    directory = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in entries)
    return b"".join((head, directory, b"\0\0\0\0\0\0", samples.data))
