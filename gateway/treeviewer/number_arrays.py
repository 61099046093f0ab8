"""Takes the long number arrays out of a request's JSON, so that Python's reader sees only what remains.

Each array is replaced by a short string that holds a secret of this message and the array's number; no client can write
such a string. ``Numbers`` turns such strings, or plain lists, into numpy arrays.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.treeviewer import json_kernels
from gateway.treeviewer.arrays import ArrayError, PackedArray

LEAST_NUMBERS: Final = 256
"""Shorter arrays stay JSON: more than a path may have elements, fewer than what takes noticeable time."""
MOST_ARRAYS: Final = 65_536
"""Of one message; the rest stays JSON."""
WORTH_SCANNING: Final = (b'"points"', b'"vertices"', b'"ranges"')
"""Keys whose values are long."""


class JsonError(ValueError):
    """The text is not JSON; the message says where."""


@dataclass(frozen=True, slots=True)
class _Array:
    begin: int
    end: int
    count: int
    rows: int
    columns: int
    depth: int


class Numbers:
    """Number arrays of one request, from lists, from the text, or from bytes."""

    __slots__ = ("_arrays", "_data", "_prefix")

    def __init__(self) -> None:
        self._prefix = ""
        self._data: NDArray[np.uint8] | None = None
        self._arrays: list[_Array] = []

    def take_from(self, data: memoryview) -> bytes:
        """The JSON without its long arrays, which are kept here by their place in ``data``."""
        text = np.frombuffer(data, np.uint8)
        table = np.empty((MOST_ARRAYS if len(data) > MOST_ARRAYS else 64, 6), np.int64)
        found = json_kernels.find_arrays(text, table, LEAST_NUMBERS)
        if not found:
            return bytes(data)
        self._data = text
        self._prefix = f"\x00{os.urandom(12).hex()}:"
        quoted = '"\\u0000' + self._prefix[1:]
        pieces: list[bytes | memoryview] = []
        position = 0
        for index, row in enumerate(table[:found].tolist()):
            array = _Array(*row)
            self._arrays.append(array)
            pieces.append(data[position : array.begin])
            pieces.append(f'{quoted}{index}"'.encode())
            position = array.end
        pieces.append(data[position:])
        return b"".join(pieces)

    def holds(self, value: str) -> bool:
        """Whether the string stands for an array that was taken out."""
        return bool(self._prefix) and value.startswith(self._prefix)

    def floats(self, value: Any, columns: tuple[int, ...], most: int) -> NDArray[np.float32]:
        """(N, columns) float32, or (N,) where ``columns`` is (1,). The first of ``columns`` is meant when N is 0.

        Raises:
            ArrayError: wrong shape, not numbers, or more than ``most`` rows.
        """
        if isinstance(value, PackedArray):
            return value.floats(columns, most)
        array = self._held(value)
        if array is None:
            listed = _from_list(value, columns, most)
            with np.errstate(over="ignore"):
                return listed.astype(np.float32)
        width = _check(array, columns, most)
        return self._read(array, np.empty(array.count, np.float32), width)

    def indices(self, value: Any, bound: int, most: int) -> NDArray[np.uint32]:
        """(N, 3) uint32, each less than ``bound``.

        Raises:
            ArrayError: wrong shape, not such indices, or more than ``most`` rows.
        """
        if isinstance(value, PackedArray):
            return value.indices(bound, most)
        array = self._held(value)
        if array is None:
            values = _from_list(value, (3,), most)
        else:
            _check(array, (3,), most)
            values = self._read(array, np.empty(array.count, np.float64), 3)
        out = np.empty(values.shape, np.uint32)
        wrong = json_kernels.to_indices(values.reshape(-1), out.reshape(-1), float(bound))
        if wrong >= 0:
            number = float(values.reshape(-1)[wrong])
            raise ArrayError(f"has {number:.17g} in row {wrong // 3}, but there are {bound} vertices")
        return out

    def _held(self, value: Any) -> _Array | None:
        if isinstance(value, str) and self.holds(value):
            return self._arrays[int(value[len(self._prefix) :])]
        return None

    def _read(self, array: _Array, out: NDArray[Any], width: int) -> NDArray[Any]:
        assert self._data is not None
        wrong = json_kernels.read_numbers(self._data, array.begin, array.end, _POWERS, out)
        if wrong >= 0:
            around = bytes(self._data[wrong : wrong + 12]).decode("ascii", "replace")
            raise JsonError(f"at byte {wrong}: {around!r} where a number should be")
        return out if width == 1 else out.reshape(-1, width)


_POWERS: Final = json_kernels.powers_of_ten()


def _check(array: _Array, columns: tuple[int, ...], most: int) -> int:
    """The number of columns, which is one of ``columns``."""
    rows = array.rows if array.depth == 2 else array.count
    if rows > most:
        raise ArrayError(f"has {rows} rows, the limit is {most}")
    width = array.columns if array.depth == 2 else 1
    if array.depth == 2 and width == -1:
        raise ArrayError("has rows of different lengths")
    if array.depth == 2 and width == 1 and 1 in columns:
        return 1
    if width not in columns or (array.depth == 2) != (width != 1):
        raise ArrayError(f"has {'numbers' if array.depth == 1 else f'rows of {width}'}, not {_wanted(columns)}")
    return width


def _from_list(value: Any, columns: tuple[int, ...], most: int) -> NDArray[np.float64]:
    if not isinstance(value, list):
        raise ArrayError(f"must be a list of {_wanted(columns)}")
    if len(value) > most:
        raise ArrayError(f"has {len(value)} rows, the limit is {most}")
    if not value:
        return np.empty((0, columns[0]) if columns[0] > 1 else (0,))
    try:
        array = np.array(value)
    except ValueError:
        raise ArrayError(_first_ragged(value, columns)) from None
    if array.dtype.kind not in "iufb":
        raise ArrayError("has something that is not a number")
    if array.ndim == 2 and array.shape[1] == 1 and 1 in columns:
        array = array.reshape(-1)
    width = array.shape[1] if array.ndim == 2 else 1
    if array.ndim > 2 or width not in columns or (array.ndim == 2) != (width != 1):
        raise ArrayError(f"has {'numbers' if array.ndim == 1 else f'rows of {width}'}, not {_wanted(columns)}")
    return array.astype(np.float64)


def _wanted(columns: tuple[int, ...]) -> str:
    return "numbers" if columns == (1,) else f"rows of {' or '.join(str(c) for c in columns)} numbers"


def _first_ragged(value: list[Any], columns: tuple[int, ...]) -> str:
    for index, row in enumerate(value):
        size = len(row) if isinstance(row, list) else 1
        if size not in columns:
            return f"has {size} {'number' if size == 1 else 'numbers'} in row {index}, rows of {columns[0]} are wanted"
    return "has rows of different lengths"
