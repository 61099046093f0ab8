"""TIFF 6.0, the smallest file that every reader takes: little endian, one directory, one strip, no compression."""

from __future__ import annotations

import ctypes
import struct
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_SHORT: Final = 3
"""Field types (TIFF 6.0, section 2)."""
_LONG: Final = 4
_UINT: Final = 1
"""Values of SampleFormat (section 19)."""
_IEEE_FLOAT: Final = 3
_TAGS: Final = 10
_DATA_OFFSET: Final = 136
"""8 header bytes, the directory (2 + 10 * 12 + 4 bytes), padded to 8 so that samples can be mapped."""


def tiff_float32(image: NDArray[np.float32]) -> bytes:
    """(H, W) float32 -> TIFF, 32-bit IEEE float, one sample per pixel; inf and NaN are kept."""
    if image.dtype != np.float32:
        raise ValueError(f"expected (H, W) float32, got {image.shape} {image.dtype.name}")
    return _tiff(image, "<f4", 32, _IEEE_FLOAT)


def tiff_gray16(image: NDArray[np.uint16]) -> bytes:
    """(H, W) uint16 -> TIFF, 16-bit unsigned, one sample per pixel."""
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
    # A SHORT is left-justified in the 4-byte value field, which little endian makes the same as a LONG.
    directory = b"".join(struct.pack("<HHII", tag, kind, 1, value) for tag, kind, value in entries)
    return _with_samples(b"".join((head, directory, b"\0\0\0\0\0\0")), samples)


def _with_samples(head: bytes, samples: NDArray[np.generic]) -> bytes:
    """A file of what comes before the samples, and these; joining them would hold the GIL all the while."""
    length = len(head) + samples.nbytes
    if length < _RELEASE_FROM:
        return b"".join((head, samples.data))
    file: bytes = _new_bytes(None, length)
    begin = id(file) + _CONTENTS
    ctypes.memmove(begin, head, len(head))
    ctypes.memmove(begin + len(head), samples.__array_interface__["data"][0], samples.nbytes)
    return file


_RELEASE_FROM: Final = 256 << 10
"""Bytes. Fewer are copied sooner than another thread has taken the GIL and given it back."""
_CONTENTS: Final = bytes.__basicsize__ - 1
"""Where the contents of a ``bytes`` object begin; the size counts the zero that ends them."""
_new_bytes: Final[Any] = ctypes.pythonapi.PyBytes_FromStringAndSize
"""Of no contents yet: whoever makes them fills them before anybody sees them, as the C API has it."""
_new_bytes.restype, _new_bytes.argtypes = ctypes.py_object, (ctypes.c_char_p, ctypes.c_ssize_t)
