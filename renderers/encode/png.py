"""PNG (ISO/IEC 15948, W3C PNG third edition): every row filtered with Up, deflated by ISA-L.

Several times faster than libpng's encoders at comparable size: rendered pictures repeat from row to row, so one filter
suffices, and ISA-L's fastest levels find those repetitions. numpy's subtraction, OpenCV's channel shuffle, the deflate
and the checksum all release the GIL. Nothing here needs a compiler or a warm-up.

Pixels come back exactly. The file itself may differ now and then for equal pixels: ISA-L does not promise to choose the
same repetitions every time, and was seen not to (about once in 5,000 pictures, with memory filled with garbage).
"""

from __future__ import annotations

import struct
from typing import Final

import cv2
import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_GRAY: Final = 0
"""Colour types of IHDR (section 11.2.1)."""
_RGB: Final = 2
_RGBA: Final = 6
_FILTER_UP: Final = 2
"""Section 9.2: each byte minus the byte above it; above the first row is zero."""

_LEVEL_8: Final = 1
"""ISA-L level of 8-bit pictures: files a fifth smaller than with level 0 for the same time."""
_LEVEL_16: Final = 0
"""ISA-L level of 16-bit pictures, whose low bytes are noise: level 1 gains nothing."""
_BAND_BYTES: Final = 1 << 18
"""Rows are filtered and deflated in bands of about this size: they stay in the second-level cache, and no picture-sized
buffer is allocated (fresh pages cost as much as the filter)."""


def png_rgb(image: NDArray[np.uint8], *, level: int = _LEVEL_8) -> bytes:
    """(H, W, 3) uint8 RGB -> PNG, 8 bit truecolour. ``level``: 0 (fastest) .. 3 of ISA-L."""
    return _png(_checked(image, 3, np.uint8), 8, _RGB, level)


def png_rgba(image: NDArray[np.uint8], *, level: int = _LEVEL_8) -> bytes:
    """(H, W, 4) uint8 RGBA, straight alpha -> PNG, 8 bit truecolour with alpha."""
    return _png(_checked(image, 4, np.uint8), 8, _RGBA, level)


def png_gray8(image: NDArray[np.uint8], *, level: int = _LEVEL_8) -> bytes:
    """(H, W) uint8 -> PNG, 8 bit greyscale."""
    return _png(_checked(image, 1, np.uint8), 8, _GRAY, level)


def png_gray16(image: NDArray[np.uint16], *, level: int = _LEVEL_16) -> bytes:
    """(H, W) uint16 -> PNG, 16 bit greyscale."""
    big_endian = _checked(image, 1, np.uint16).astype(">u2")
    return _png(big_endian.view(np.uint8), 16, _GRAY, level, width=image.shape[1])


def png_label(labels: NDArray[np.uint32], *, level: int = _LEVEL_8) -> bytes:
    """(H, W) uint32 labels -> PNG, 8 bit truecolour; red is the low byte, blue the third, the top is lost."""
    little_endian = _checked(labels, 1, np.uint32).astype("<u4", copy=False)
    rgba = little_endian.view(np.uint8).reshape(*labels.shape, 4)
    return png_rgb(np.asarray(cv2.cvtColor(rgba, cv2.COLOR_RGBA2RGB), dtype=np.uint8), level=level)


def _checked(image: NDArray[np.generic], channels: int, dtype: type[np.generic]) -> NDArray[np.generic]:
    """The image as C-contiguous rows; raises ValueError when it is not what the writer takes."""
    expected = "(H, W)" if channels == 1 else f"(H, W, {channels})"
    if image.dtype != dtype or image.ndim != (2 if channels == 1 else 3) or image.shape[2:] not in ((), (channels,)):
        raise ValueError(f"expected {expected} {np.dtype(dtype).name}, got {image.shape} {image.dtype.name}")
    if not 0 < image.shape[0] < 1 << 31 or not 0 < image.shape[1] < 1 << 31:
        raise ValueError(f"a PNG has at least one pixel, got {image.shape}")
    return np.ascontiguousarray(image)


def _png(image: NDArray[np.generic], bits: int, color_type: int, level: int, *, width: int | None = None) -> bytes:
    height = image.shape[0]
    rows = image.view(np.uint8).reshape(height, -1)
    header = struct.pack(">IIBBBBB", width or image.shape[1], height, bits, color_type, 0, 0, 0)
    parts = [_SIGNATURE, *_chunk(b"IHDR", header), *_chunk(b"IDAT", *_deflated(rows, level)), *_chunk(b"IEND")]
    return b"".join(parts)


def _deflated(rows: NDArray[np.uint8], level: int) -> list[bytes]:
    """(H, N) uint8 -> the zlib stream of the filtered rows, in pieces."""
    height, row_bytes = rows.shape
    step = max(1, min(height, _BAND_BYTES // (row_bytes + 1)))
    band = np.empty((step, row_bytes + 1), dtype=np.uint8)
    band[:, 0] = _FILTER_UP
    compressor = isal_zlib.compressobj(level)
    pieces: list[bytes] = []
    for top in range(0, height, step):
        count = min(step, height - top)
        if top == 0:
            band[0, 1:] = rows[0]
            np.subtract(rows[1:count], rows[: count - 1], out=band[1:count, 1:])
        else:
            np.subtract(rows[top : top + count], rows[top - 1 : top + count - 1], out=band[:count, 1:])
        pieces.append(compressor.compress(band[:count]))
    pieces.append(compressor.flush())
    return pieces


def _chunk(kind: bytes, *data: bytes) -> list[bytes]:
    """Section 5.3: length, type, data, CRC over type and data."""
    crc = isal_zlib.crc32(kind)
    for piece in data:
        crc = isal_zlib.crc32(piece, crc)
    return [struct.pack(">I", sum(map(len, data))), kind, *data, struct.pack(">I", crc)]
