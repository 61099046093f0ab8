"""Number arrays as bytes: extension type 1 of the binary format (docs/tree-viewer-binary.md)."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

EXTENSION: Final = 1
"""MessagePack's extension type of a number array."""
TYPES: Final = {
    name: np.dtype(f"<{name}") for name in ("f2", "f4", "f8", "u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8")
}
"""Kind (float, unsigned, integer) and bytes of one number, all little endian."""
_HEAD: Final = struct.Struct("<2sBB")


class ArrayError(ValueError):
    """An array is not of the wanted shape; the message starts with a verb (``has 2 numbers in row 7, not 3``)."""


@dataclass(frozen=True, slots=True, eq=False)
class PackedArray:
    """An array as it came; nothing is copied before its shape was looked at."""

    values: NDArray[Any] | None
    """A view of the message, possibly not aligned; None: see ``fault``."""
    fault: str = ""

    def floats(self, columns: tuple[int, ...], most: int) -> NDArray[np.float32]:
        """(N, columns) float32 of its own memory, or (N,) where ``columns`` is (1,).

        Raises:
            ArrayError: wrong shape, or more than ``most`` rows.
        """
        values = self._shaped(columns, most)
        with np.errstate(over="ignore", invalid="ignore"):
            return values.astype(np.float32, order="C")

    def indices(self, bound: int, most: int) -> NDArray[np.uint32]:
        """(N, 3) uint32, each less than ``bound``.

        Raises:
            ArrayError: wrong shape, not such indices, or more than ``most`` rows.
        """
        values = self._shaped((3,), most)
        if values.dtype.kind == "f":
            raise ArrayError("has floating-point numbers, not indices")
        wrong = values >= bound if values.dtype.kind == "u" else (values >= bound) | (values < 0)
        if wrong.any():
            row, column = divmod(int(np.argmax(wrong)), 3)
            raise ArrayError(f"has {values[row, column]} in row {row}, but there are {bound} vertices")
        return values.astype(np.uint32, order="C")

    @property
    def of_bytes(self) -> bool:
        """Whether it has numbers of 0 to 255, which as colours mean 0 to 1."""
        return self.values is not None and self.values.dtype == np.uint8

    def _shaped(self, columns: tuple[int, ...], most: int) -> NDArray[Any]:
        values = self.values
        if values is None:
            raise ArrayError(self.fault)
        if len(values) > most:
            raise ArrayError(f"has {len(values)} rows, the limit is {most}")
        width = values.shape[1] if values.ndim == 2 else 1
        if width not in columns:
            wanted = "numbers" if columns == (1,) else f"rows of {' or '.join(map(str, columns))} numbers"
            raise ArrayError(f"has {'numbers' if values.ndim == 1 else f'rows of {width}'}, not {wanted}")
        return values.reshape(-1) if width == 1 else values


def unpack(payload: memoryview) -> PackedArray:
    """An extension's payload; what is wrong with it is told when the array is used."""
    if len(payload) < _HEAD.size:
        return PackedArray(None, f"has {len(payload)} bytes, less than an array's head")
    name, dimensions, reserved = _HEAD.unpack_from(payload)
    kind = TYPES.get(name.decode("ascii", "replace"))
    if kind is None:
        return PackedArray(None, f"has numbers of type {name!r}, not of {', '.join(TYPES)}")
    if reserved != 0:
        return PackedArray(None, f"has {reserved} in byte 3 of its head, which must be 0")
    begin = _HEAD.size + 4 * dimensions
    if dimensions not in (1, 2) or len(payload) < begin:
        return PackedArray(None, f"has {dimensions} dimensions, 1 or 2 are possible")
    shape = struct.unpack_from(f"<{dimensions}I", payload, _HEAD.size)
    size = math.prod(shape) * kind.itemsize
    if size != len(payload) - begin:
        return PackedArray(None, f"has {len(payload) - begin} bytes of numbers, its shape needs {size}")
    return PackedArray(np.frombuffer(payload, kind, offset=begin).reshape(shape))


def pack(values: NDArray[Any]) -> bytes:
    """The payload of an array of one or two dimensions, for tests and benchmarks."""
    little = np.ascontiguousarray(values, values.dtype.newbyteorder("<"))
    head = _HEAD.pack(values.dtype.str[1:].encode(), values.ndim, 0)
    return b"".join((head, struct.pack(f"<{values.ndim}I", *values.shape), little.data if values.size else b""))
