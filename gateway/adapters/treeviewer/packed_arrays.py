"""Number arrays in MessagePack requests: extension type 1, defined in docs/tree-viewer-binary.md."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

EXTENSION: Final = 1
"""MessagePack extension type of number arrays."""
DTYPES: Final = {
    name: np.dtype(f"<{name}") for name in ("f2", "f4", "f8", "u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8")
}
"""Number types by name: float, unsigned or signed integer, and the size of a number in bytes. All are little-endian."""
_HEADER: Final = struct.Struct("<2sBB")
"""Name of the number type, number of dimensions, a reserved 0. The dimensions follow as uint32."""


class ArrayError(ValueError):
    """An array has an invalid shape or value.

    The message is a sentence without its subject, the field's name (``has 2 numbers in row 7, not 3``).
    """


@dataclass(frozen=True, slots=True, eq=False)
class PackedArray:
    """An array as received. ``NumberArrays`` checks its shape, then copies and converts its numbers."""

    values: NDArray[Any] | None
    """A view of the message, possibly unaligned; None if there is a ``fault``."""
    fault: str = ""

    def pixels(self, max_pixels: int) -> NDArray[np.uint8]:
        """Return an image, (H, W) or (H, W, channels) uint8, without a copy.

        Raises:
            ArrayError: not uint8, wrong shape, no pixels, or too many.
        """
        values = self.values
        if values is None:
            raise ArrayError(self.fault)
        if values.dtype != np.uint8 or values.ndim not in (2, 3) or values.shape[2:] not in ((), (1,), (3,), (4,)):
            raise ArrayError(f"has shape {values.shape} and type {values.dtype}, not (H, W), (H, W, 3 or 4) and uint8")
        if not values.size:
            raise ArrayError("has no pixels")
        if values.shape[0] * values.shape[1] > max_pixels:
            raise ArrayError(f"has {values.shape[1]}x{values.shape[0]} pixels, the limit is {max_pixels}")
        return values

    @property
    def is_uint8(self) -> bool:
        """True if the numbers are uint8. Colours of this type are from 0 to 255, others from 0 to 1."""
        return self.values is not None and self.values.dtype == np.uint8


def unpack(payload: memoryview) -> PackedArray:
    """Return the array in an extension's payload. A fault in it is reported only when the array is used."""
    if len(payload) < _HEADER.size:
        return PackedArray(None, f"has {len(payload)} bytes, less than an array's head")
    name, dimensions, reserved = _HEADER.unpack_from(payload)
    dtype = DTYPES.get(name.decode("ascii", "replace"))
    if dtype is None:
        return PackedArray(None, f"has numbers of type {name!r}, not of {', '.join(DTYPES)}")
    if reserved != 0:
        return PackedArray(None, f"has {reserved} in byte 3 of its head, which must be 0")
    begin = _HEADER.size + 4 * dimensions
    if dimensions not in (1, 2, 3) or len(payload) < begin:
        return PackedArray(None, f"has {dimensions} dimensions, 1 to 3 are possible")
    shape = struct.unpack_from(f"<{dimensions}I", payload, _HEADER.size)
    size = math.prod(shape) * dtype.itemsize
    if size != len(payload) - begin:
        return PackedArray(None, f"has {len(payload) - begin} bytes of numbers, its shape needs {size}")
    return PackedArray(np.frombuffer(payload, dtype, offset=begin).reshape(shape))
