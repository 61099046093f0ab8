"""Random access to the lines of a large file. The manifest of a million samples has 1 GB."""

from __future__ import annotations

import os
import weakref
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.client.manifest import MAX_LINE, RecordError

_BLOCK_BYTES: Final = 4 << 20


class Lines:
    """Sequence of the lines of a file, without newlines. Memory holds 8 bytes per line.

    The file stays open, so that replacing it does not change the lines. Threads and forked processes may read
    concurrently.
    """

    def __init__(self, path: Path) -> None:
        """
        Raises:
            RecordError: the file is not readable, a line exceeds ``MAX_LINE``, or the last line has no newline.
        """
        self._path = path
        self._file = self._open()
        line_starts: list[NDArray[np.int64]] = [np.zeros(1, np.int64)]
        size = 0
        while block := os.pread(self._file, _BLOCK_BYTES, size):
            line_starts.append(np.flatnonzero(np.frombuffer(block, np.uint8) == ord("\n")) + (size + 1))
            size += len(block)
        self._starts = np.concatenate(line_starts)
        too_long = np.flatnonzero(np.diff(self._starts, append=size) > MAX_LINE)
        if too_long.size:
            raise RecordError(f"{self.location(int(too_long[0]))}: longer than the limit")
        if self._starts[-1] != size:
            raise RecordError(f"{self.location(len(self))}: cut off")

    def _open(self) -> int:
        try:
            file = os.open(self._path, os.O_RDONLY | os.O_CLOEXEC)
        except OSError as error:
            raise RecordError(f"{self._path}: {error.strerror or error}") from None
        weakref.finalize(self, os.close, file)
        return file

    def __len__(self) -> int:
        return len(self._starts) - 1

    def __getitem__(self, number: int) -> bytes:
        if number < 0:
            number += len(self)
        if not 0 <= number < len(self):
            raise IndexError(f"line {number} of {len(self)}")
        start, end = int(self._starts[number]), int(self._starts[number + 1])
        return os.pread(self._file, end - start - 1, start)

    def location(self, number: int) -> str:
        """Return file and line number, for error messages."""
        return f"{self._path}, line {number + 1}"

    def __getstate__(self) -> tuple[Path, NDArray[np.int64]]:
        return self._path, self._starts

    def __setstate__(self, state: tuple[Path, NDArray[np.int64]]) -> None:
        self._path, self._starts = state
        self._file = self._open()
        if os.fstat(self._file).st_size != self._starts[-1]:
            raise RecordError(f"{self._path} has changed")
