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
    """An array as received. Its numbers are copied and converted only after the check of its shape."""

    values: NDArray[Any] | None
    """A view of the message, possibly unaligned; None if there is a ``fault``."""
    fault: str = ""

    def floats(self, columns: tuple[int, ...], max_rows: int) -> NDArray[np.float32]:
        """Return a copy as float32: (N, one of ``columns``), or (N,) for one column.

        Raises:
            ArrayError: wrong shape, or too many rows.
        """
        values = self._checked(columns, max_rows)
        with np.errstate(over="ignore", invalid="ignore"):
            return values.astype(np.float32, order="C")

    def doubles(self, columns: tuple[int, ...], max_rows: int) -> NDArray[np.float64]:
        """Return a copy as float64. See ``floats``."""
        return self._checked(columns, max_rows).astype(np.float64, order="C")

    def indices(self, count: int, max_rows: int) -> NDArray[np.uint32]:
        """Return a copy as triangles, (N, 3) uint32 indices of ``count`` vertices.

        Raises:
            ArrayError: wrong shape, a value that is not an index from 0 to ``count`` - 1, or too many rows.
        """
        values = self._checked((3,), max_rows)
        if values.dtype.kind == "f":
            raise ArrayError("has floating-point numbers, not indices")
        invalid = values >= count if values.dtype.kind == "u" else (values >= count) | (values < 0)
        if invalid.any():
            row, column = divmod(int(np.argmax(invalid)), 3)
            raise ArrayError(f"has {values[row, column]} in row {row}, but there are {count} vertices")
        return values.astype(np.uint32, order="C")

    def grid(self, max_numbers: int) -> NDArray[np.float32]:
        """Return a copy of rows of any length as float32, (R, C).

        Raises:
            ArrayError: not two dimensions, or too many numbers.
        """
        if self.values is None:
            raise ArrayError(self.fault)
        if self.values.ndim != 2:
            raise ArrayError(f"has {shape_text(self.values.ndim, 0)}, not rows of numbers")
        check_size(self.values.size, max_numbers)
        with np.errstate(over="ignore", invalid="ignore"):
            return self.values.astype(np.float32, order="C")

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

    def _checked(self, columns: tuple[int, ...], max_rows: int) -> NDArray[Any]:
        """Return the values, (N, columns) or (N,), after a check of their shape."""
        values = self.values
        if values is None:
            raise ArrayError(self.fault)
        if len(values) > max_rows:
            raise ArrayError(f"has {len(values)} rows, the limit is {max_rows}")
        if values.ndim > 2:
            raise ArrayError(f"has {values.ndim} dimensions, not {columns_text(columns)}")
        column_count = values.shape[1] if values.ndim == 2 else 1
        if column_count not in columns:
            raise ArrayError(f"has {shape_text(values.ndim, column_count)}, not {columns_text(columns)}")
        return values.reshape(-1) if column_count == 1 else values


def shape_text(dimensions: int, columns: int) -> str:
    """Return a description of an array's rows, for an error text."""
    return "numbers" if dimensions == 1 else f"rows of {columns}"


def check_size(numbers: int, max_numbers: int) -> None:
    """Raise ArrayError if an array has too many numbers."""
    if numbers > max_numbers:
        raise ArrayError(f"has {numbers} numbers, the limit is {max_numbers}")


def columns_text(columns: tuple[int, ...]) -> str:
    """Return a description of the allowed rows, for an error text. ``columns`` are the allowed numbers of columns."""
    return "numbers" if columns == (1,) else f"rows of {' or '.join(map(str, columns))} numbers"


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


def pack(values: NDArray[Any]) -> bytes:
    """Return the payload of an array of one to three dimensions, for tests and benchmarks."""
    little_endian = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    header = _HEADER.pack(values.dtype.str[1:].encode(), values.ndim, 0)
    return b"".join(
        (header, struct.pack(f"<{values.ndim}I", *values.shape), little_endian.data if values.size else b"")
    )
