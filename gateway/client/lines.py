"""Single lines of a file of many: a manifest of a million samples has 0.8 GB, and a reader wants one line of it."""

from __future__ import annotations

import mmap
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.client.manifest import MAX_LINE, RecordError

_BLOCK: Final = 16 << 20


class Lines:
    """The lines of a file, by number from 0, without their ends; 8 bytes of memory each.

    The file is mapped: one that is replaced meanwhile (by renaming another one) stays what it was.
    """

    def __init__(self, path: Path) -> None:
        """
        Raises:
            RecordError: it cannot be read, has a line beyond ``MAX_LINE``, or its last line is cut off.
        """
        self._path = path
        self._data = _mapped(path)
        found: list[NDArray[np.int64]] = [np.zeros(1, np.int64)]
        for start in range(0, len(self._data), _BLOCK):
            block = np.frombuffer(self._data, np.uint8, min(_BLOCK, len(self._data) - start), start)
            found.append(np.flatnonzero(block == ord("\n")) + (start + 1))
        self._starts = np.concatenate(found)
        long = np.flatnonzero(np.diff(self._starts, append=len(self._data)) > MAX_LINE)
        if long.size:
            raise RecordError(f"{self.where(int(long[0]))}: longer than the limit")
        if self._starts[-1] != len(self._data):
            raise RecordError(f"{self.where(len(self))}: cut off")

    def __len__(self) -> int:
        return len(self._starts) - 1

    def __getitem__(self, number: int) -> bytes:
        if number < 0:
            number += len(self)
        if not 0 <= number < len(self):
            raise IndexError(f"line {number} of {len(self)}")
        return self._data[int(self._starts[number]) : int(self._starts[number + 1]) - 1]

    def where(self, number: int) -> str:
        """For messages."""
        return f"{self._path}, line {number + 1}"

    def __getstate__(self) -> tuple[Path, NDArray[np.int64]]:
        return self._path, self._starts

    def __setstate__(self, state: tuple[Path, NDArray[np.int64]]) -> None:
        self._path, self._starts = state
        self._data = _mapped(self._path)
        if len(self._data) != self._starts[-1]:
            raise RecordError(f"{self._path} has changed")


def _mapped(path: Path) -> mmap.mmap | bytes:
    try:
        with path.open("rb") as file:
            if path.stat().st_size == 0:  # nothing cannot be mapped
                return b""
            return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    except OSError as error:
        raise RecordError(f"{path}: {error.strerror or error}") from None
