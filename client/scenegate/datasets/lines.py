"""Random access to the lines of a large file: a manifest has 1 GB for a million samples."""

import os
import weakref
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from scenegate.datasets.manifest import MAX_LINE_BYTES, RecordError
from scenegate.regular_files import errors_as, open_regular

_BLOCK_BYTES: Final = 4 << 20
"""Bytes read at a time in the search for newlines."""


class Lines:
    """The lines of a file, as bytes without newlines. It takes 8 bytes of memory per line.

    The file stays open, so the lines do not change when the file is replaced by another. Threads and forked processes
    may read at the same time.
    """

    def __init__(self, path: Path) -> None:
        """Open a file. Raises RecordError: not readable, a line beyond ``MAX_LINE_BYTES``, no newline at the end."""
        self._path = path
        self._descriptor = self._open()
        line_starts: list[NDArray[np.int64]] = [np.zeros(1, np.int64)]
        file_size = 0
        while block := os.pread(self._descriptor, _BLOCK_BYTES, file_size):
            line_starts.append(np.flatnonzero(np.frombuffer(block, np.uint8) == ord("\n")) + (file_size + 1))
            file_size += len(block)
        self._starts = np.concatenate(line_starts)
        """Offset of each line in bytes, and the end of the last line."""
        too_long = np.flatnonzero(np.diff(self._starts, append=file_size) > MAX_LINE_BYTES)
        if too_long.size:
            raise RecordError(f"{self.location(int(too_long[0]))}: longer than the limit")
        if self._starts[-1] != file_size:
            raise RecordError(f"{self.location(len(self))}: cut off")

    def _open(self) -> int:
        """Return a file descriptor, which is closed when this object is collected."""
        with errors_as(RecordError, self._path), open_regular(self._path) as file:
            descriptor = os.dup(file.fileno())
        weakref.finalize(self, os.close, descriptor)
        return descriptor

    def __len__(self) -> int:
        return len(self._starts) - 1

    def __getitem__(self, index: int) -> bytes:
        if index < 0:
            index += len(self)
        if not 0 <= index < len(self):
            raise IndexError(f"line {index} of {len(self)}")
        start, end = int(self._starts[index]), int(self._starts[index + 1])
        return os.pread(self._descriptor, end - start - 1, start)

    def location(self, index: int) -> str:
        """Return the path and the line number, for error messages."""
        return f"{self._path}, line {index + 1}"

    def __getstate__(self) -> tuple[Path, NDArray[np.int64]]:
        return self._path, self._starts

    def __setstate__(self, state: tuple[Path, NDArray[np.int64]]) -> None:
        self._path, self._starts = state
        self._descriptor = self._open()
        if os.fstat(self._descriptor).st_size != self._starts[-1]:
            raise RecordError(f"{self._path} has changed")
