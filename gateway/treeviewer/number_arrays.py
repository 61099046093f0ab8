"""Take long number arrays out of a request's JSON, so that Python's reader parses only the rest.

Each array is replaced by a short string with a random token and the array's index; no client can guess the token.
``NumberArrays`` turns these strings, plain lists and packed arrays into NumPy arrays.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.treeviewer import json_kernels
from gateway.treeviewer.packed_arrays import ArrayError, PackedArray, columns_text, shape_text

MIN_NUMBERS: Final = 256
"""Shorter arrays stay in the JSON: paths must, and Python reads so few numbers quickly."""
MAX_ARRAYS: Final = 65_536
"""Maximum number of arrays taken out of one message; further ones stay in the JSON."""


class JsonError(ValueError):
    """The text is not JSON; the message contains the position."""


@dataclass(frozen=True, slots=True)
class _TextArray:
    """An array in the JSON text."""

    begin: int
    end: int
    """Position in the text, in bytes."""
    count: int
    rows: int
    columns: int
    dimensions: int


class NumberArrays:
    """Number arrays of one request."""

    __slots__ = ("_arrays", "_prefix", "_text")

    def __init__(self) -> None:
        self._prefix = ""
        self._text: NDArray[np.uint8] | None = None
        self._arrays: list[_TextArray] = []

    def extract(self, data: memoryview) -> bytes:
        """Return the JSON text with strings in place of its long arrays. Keeps a reference to ``data``."""
        text = np.frombuffer(data, np.uint8)
        table = json_kernels.find_arrays(text, MAX_ARRAYS if len(data) > MAX_ARRAYS else 64, MIN_NUMBERS)
        if not len(table):
            return bytes(data)
        self._text = text
        self._prefix = f"\x00{os.urandom(12).hex()}:"
        escaped = '"\\u0000' + self._prefix[1:]
        pieces: list[bytes | memoryview] = []
        position = 0
        for index, row in enumerate(table.tolist()):
            array = _TextArray(*row)
            self._arrays.append(array)
            pieces.append(data[position : array.begin])
            pieces.append(f'{escaped}{index}"'.encode())
            position = array.end
        pieces.append(data[position:])
        return b"".join(pieces)

    def is_reference(self, value: str) -> bool:
        """Return True if a string stands for an array that was taken out."""
        return bool(self._prefix) and value.startswith(self._prefix)

    def floats(self, value: Any, columns: tuple[int, ...], max_rows: int) -> NDArray[np.float32]:
        """Return (N, columns) float32, or (N,) where ``columns`` is (1,). An empty list has the first of ``columns``.

        Raises:
            ArrayError: wrong shape, not numbers, or too many rows.
            JsonError: the text of the array is not JSON.
        """
        if isinstance(value, PackedArray):
            return value.floats(columns, max_rows)
        with np.errstate(over="ignore"):
            return self._read(value, columns, max_rows).astype(np.float32)

    def indices(self, value: Any, count: int, max_rows: int) -> NDArray[np.uint32]:
        """Return (N, 3) uint32, indices less than ``count``.

        Raises:
            ArrayError: wrong shape, values that are no such indices, or too many rows.
            JsonError: the text of the array is not JSON.
        """
        if isinstance(value, PackedArray):
            return value.indices(count, max_rows)
        values = self._read(value, (3,), max_rows)
        invalid = ~((values >= 0.0) & (values < count) & (values == np.floor(values)))
        if invalid.any():
            row, column = divmod(int(np.argmax(invalid)), 3)
            raise ArrayError(f"has {float(values[row, column]):.17g} in row {row}, but there are {count} vertices")
        return values.astype(np.uint32)

    def _read(self, value: Any, columns: tuple[int, ...], max_rows: int) -> NDArray[np.float64]:
        if isinstance(value, str) and self.is_reference(value):
            return self._parse(self._arrays[int(value[len(self._prefix) :])], columns, max_rows)
        return _from_list(value, columns, max_rows)

    def _parse(self, array: _TextArray, columns: tuple[int, ...], max_rows: int) -> NDArray[np.float64]:
        column_count = _check_shape(array, columns, max_rows)
        assert self._text is not None
        numbers, error_at = json_kernels.read_numbers(self._text, array.begin, array.end, array.count)
        if error_at >= 0:
            excerpt = bytes(self._text[error_at : error_at + 12]).decode("ascii", "replace")
            raise JsonError(f"at byte {error_at}: {excerpt!r} where a number should be")
        return numbers if column_count == 1 else numbers.reshape(-1, column_count)


def _check_shape(array: _TextArray, columns: tuple[int, ...], max_rows: int) -> int:
    """Return the number of columns, which is one of ``columns``."""
    nested = array.dimensions == 2
    rows = array.rows if nested else array.count
    column_count = array.columns if nested else 1
    if rows > max_rows:
        raise ArrayError(f"has {rows} rows, the limit is {max_rows}")
    if nested and column_count == json_kernels.RAGGED:
        raise ArrayError("has rows of different lengths")
    if nested and column_count == 1 and 1 in columns:
        return 1
    if column_count not in columns or nested != (column_count != 1):
        raise ArrayError(f"has {shape_text(array.dimensions, column_count)}, not {columns_text(columns)}")
    return column_count


def _from_list(value: Any, columns: tuple[int, ...], max_rows: int) -> NDArray[np.float64]:
    if not isinstance(value, list):
        raise ArrayError(f"must be a list of {columns_text(columns)}")
    if len(value) > max_rows:
        raise ArrayError(f"has {len(value)} rows, the limit is {max_rows}")
    if not value:
        return np.empty((0, columns[0]) if columns[0] > 1 else (0,))
    try:
        array = np.array(value)
    except ValueError:
        raise ArrayError(_describe_ragged(value, columns)) from None
    if array.dtype.kind not in "iufb":
        raise ArrayError("has something that is not a number")
    if array.ndim == 2 and array.shape[1] == 1 and 1 in columns:
        array = array.reshape(-1)
    column_count = array.shape[1] if array.ndim == 2 else 1
    if array.ndim > 2 or column_count not in columns or (array.ndim == 2) != (column_count != 1):
        raise ArrayError(f"has {shape_text(array.ndim, column_count)}, not {columns_text(columns)}")
    return array.astype(np.float64)


def _describe_ragged(value: list[Any], columns: tuple[int, ...]) -> str:
    for index, row in enumerate(value):
        size = len(row) if isinstance(row, list) else 1
        if size not in columns:
            return f"has {size} {'number' if size == 1 else 'numbers'} in row {index}, rows of {columns[0]} are wanted"
    return "has rows of different lengths"
