"""Read the number arrays of a request, from JSON text, Python lists and packed arrays (MessagePack), as NumPy arrays.

``json_kernels`` parses long arrays in JSON text. In the text that the JSON decoder gets, ``[{"token": index}]`` stands
for each of them, with a random token, which no client can guess. No field but an array accepts such a value.
docs/tree-viewer-binary.md defines packed arrays, an extension of MessagePack.
"""

import contextlib
import math
import os
import struct
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.treeviewer import json_kernels
from gateway.adapters.treeviewer.json_kernels import TextArray
from gateway.adapters.treeviewer.requests import UnreadableRequestError
from scenegate.transforms import origin_amid

MIN_NUMBERS: Final = 256
"""Shorter arrays stay in the JSON text. Paths must stay there, and Python decodes few numbers quickly."""
MAX_ARRAYS: Final = 65_536
"""Maximum number of arrays taken out of one request; further ones stay in the JSON text."""
_NUMBER_TYPES: Final = frozenset((int, float, bool, type(None)))
"""Types of the numbers in decoded lists. JSON.jl and nlohmann/json write null for NaN."""
EXTENSION: Final = 1
"""MessagePack extension type of number arrays."""
DTYPES: Final = {
    name: np.dtype(f"<{name}") for name in ("f2", "f4", "f8", "u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8")
}
"""Number types by name: float, unsigned or signed integer, and the size of a number in bytes. All are little-endian."""
_HEADER: Final = struct.Struct("<2sBB")
"""Name of the number type, number of dimensions, a reserved 0. The dimensions follow as uint32."""


class ArrayError(ValueError):
    """An array has an invalid shape or value. The message lacks its subject: ``has 2 numbers in row 7, not 3``."""


@dataclass(frozen=True, slots=True, eq=False)
class PackedArray:
    """An array as received. ``NumberArrays`` checks its shape, then copies and converts its numbers."""

    values: NDArray[Any] | None
    """A view of the message, possibly unaligned; None if there is a ``fault``."""
    fault: str = ""

    def pixels(self, max_pixels: int) -> NDArray[np.uint8]:
        """Return an image, (H, W) or (H, W, channels), without a copy. Raises ArrayError if it is not one, or large."""
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


@dataclass(slots=True)
class NumberArrays:
    """Number arrays of one request, whatever its format."""

    _token: str = ""
    _text: NDArray[np.uint8] | None = None
    _arrays: list[TextArray] = field(default_factory=list)

    def extract(self, data: memoryview) -> bytes:
        """Return the JSON text with short values in place of its long arrays. Keeps a reference to ``data``."""
        text = np.frombuffer(data, np.uint8)
        self._arrays = json_kernels.find_arrays(text, MAX_ARRAYS, MIN_NUMBERS)
        if not self._arrays:
            return bytes(data)
        self._text = text
        self._token = f"\x00{os.urandom(12).hex()}"
        pieces: list[bytes | memoryview] = []
        position = 0
        for index, array in enumerate(self._arrays):
            pieces.append(data[position : array.begin])
            pieces.append(f'[{{"\\u0000{self._token[1:]}":{index}}}]'.encode())
            position = array.end
        pieces.append(data[position:])
        return b"".join(pieces)

    def floats(self, value: Any, columns: tuple[int, ...], max_rows: int) -> NDArray[np.float32]:
        """Return a copy of a field's numbers as float32: (N, one of ``columns``), or (N,) for one column.

        ``value``: a list, a packed array, or the value that stands for an array in the JSON text. An empty list gets
        the first of ``columns``. Raises ArrayError, or RequestError if the text of the array is not JSON.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            return self._rows(value, columns, max_rows).astype(np.float32, order="C")

    def positions(self, value: Any, max_rows: int) -> tuple[NDArray[np.float32], tuple[float, float, float]]:
        """Return a copy of a field's points, (N, 3), from the point of ``origin_amid``, and this. See ``floats``."""
        values = self._rows(value, (3,), max_rows)
        origin = origin_amid(values)
        with np.errstate(over="ignore", invalid="ignore"):
            return (values - origin if any(origin) else values).astype(np.float32, order="C"), origin

    def doubles(self, value: Any, columns: tuple[int, ...], max_rows: int) -> NDArray[np.float64]:
        """Return a field's numbers as float64. See ``floats``."""
        return self._rows(value, columns, max_rows).astype(np.float64, order="C")

    def indices(self, value: Any, count: int, max_rows: int) -> NDArray[np.uint32]:
        """Return a field's triangles, (N, 3) indices of ``count`` vertices. Value and errors as for ``floats``."""
        values = self._rows(value, (3,), max_rows)
        valid = values < count
        if values.dtype.kind == "f":
            if isinstance(value, PackedArray):
                raise ArrayError("has floating-point numbers, not indices")
            valid &= values == np.floor(values)
        if values.dtype.kind != "u":
            valid &= values >= 0
        if not valid.all():
            row, column = divmod(int(np.argmin(valid)), 3)
            number = values[row, column].item()
            text = f"{number:.17g}" if isinstance(number, float) else number
            raise ArrayError(f"has {text} in row {row}, but there are {count} vertices")
        return values.astype(np.uint32, order="C")

    def grid(self, value: Any, max_numbers: int) -> NDArray[np.float32]:
        """Return a copy of a field's rows of any length as float32, (R, C). Value and errors as for ``floats``."""
        first_row = value[0] if isinstance(value, list) and value else None
        columns = len(first_row) if isinstance(first_row, list) else 2
        values = self._values(value, (columns,), max_numbers)
        if values.ndim != 2:
            raise ArrayError(f"has {_shape_text(values)}, not rows of numbers")
        if values.size > max_numbers:
            raise ArrayError(f"has {values.size} numbers, the limit is {max_numbers}")
        with np.errstate(over="ignore", invalid="ignore"):
            return values.astype(np.float32, order="C")

    def _rows(self, value: Any, columns: tuple[int, ...], max_rows: int) -> NDArray[Any]:
        """Return a field's numbers after a check of their shape: (N, columns), or (N,) for one column."""
        values = self._values(value, columns, max_rows)
        column_count = values.shape[1] if values.ndim == 2 else 1
        if values.ndim > 2 or column_count not in columns:
            raise ArrayError(f"has {_shape_text(values)}, not {_columns_text(columns)}")
        return values.reshape(-1) if column_count == 1 else values

    def _values(self, value: Any, columns: tuple[int, ...], max_rows: int) -> NDArray[Any]:
        """Return a field's numbers, of any shape and type, as they were sent; ``columns`` are for an error text."""
        if isinstance(value, PackedArray):
            if value.values is None:
                raise ArrayError(value.fault)
            _check_rows(len(value.values), max_rows)
            return value.values
        array = self._extracted(value)
        if array is not None:
            _check_rows(array.rows if array.dimensions == 2 else array.number_count, max_rows)
            return self._parse(array)
        if not isinstance(value, list):
            raise ArrayError(f"must be a list of {_columns_text(columns)}")
        _check_rows(len(value), max_rows)
        return _from_list(value, columns)

    def _extracted(self, value: Any) -> TextArray | None:
        """Return the array of the JSON text that a decoded value stands for; None for other values."""
        if self._text is None or not isinstance(value, list) or len(value) != 1 or not isinstance(value[0], dict):
            return None
        index = value[0].get(self._token)
        return None if index is None else self._arrays[index]

    def _parse(self, array: TextArray) -> NDArray[np.float64]:
        """Return the numbers of an array in the JSON text."""
        if array.dimensions == 2 and array.columns == json_kernels.MIXED_COLUMNS:
            raise ArrayError("has rows of different lengths")
        assert self._text is not None
        numbers, error_at = json_kernels.read_numbers(self._text, array.begin, array.end, array.number_count)
        if error_at >= 0:
            excerpt = bytes(self._text[error_at : error_at + 12]).decode("ascii", "replace")
            raise UnreadableRequestError(
                f"the request is not valid JSON at byte {error_at}: {excerpt!r} where a number should be"
            )
        return numbers.reshape(array.rows, array.columns) if array.dimensions == 2 else numbers


def _check_rows(rows: int, max_rows: int) -> None:
    if rows > max_rows:
        raise ArrayError(f"has {rows} rows, the limit is {max_rows}")


def _from_list(value: list[Any], columns: tuple[int, ...]) -> NDArray[Any]:
    """Return the numbers of a Python list, or of a list of lists."""
    if not value:
        return np.empty((0, columns[0]) if columns[0] > 1 else (0,))
    try:
        array = np.array(value)
    except ValueError:
        raise ArrayError(_describe_ragged(value, columns)) from None
    if array.dtype.kind == "O" and _NUMBER_TYPES.issuperset(map(type, array.flat)):
        with contextlib.suppress(OverflowError):  # an integer above 1.8e308
            array = array.astype(np.float64)  # None becomes NaN
    if array.dtype.kind not in "iufb":
        raise ArrayError("has something that is not a number")
    return array.astype(np.float64)


def _shape_text(values: NDArray[Any]) -> str:
    if values.ndim == 2:
        return f"rows of {values.shape[1]}"
    return "numbers" if values.ndim == 1 else f"{values.ndim} dimensions"


def _columns_text(columns: tuple[int, ...]) -> str:
    """Return a description of the allowed rows. ``columns`` are the allowed numbers of columns."""
    return "numbers" if columns == (1,) else f"rows of {' or '.join(map(str, columns))} numbers"


def _describe_ragged(value: list[Any], columns: tuple[int, ...]) -> str:
    """Return the error text for a list whose rows have different lengths, or are nested to different depths."""
    for index, row in enumerate(value):
        row_length = len(row) if isinstance(row, list) else 1
        if row_length not in columns:
            numbers_text = "1 number" if row_length == 1 else f"{row_length} numbers"
            return f"has {numbers_text} in row {index}, rows of {columns[0]} are wanted"
    return "has rows of different lengths"
