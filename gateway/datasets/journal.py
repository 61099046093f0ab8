"""The journal of a run: one line per finished sample, in the order in which they finish.

A run may have millions of samples. Each takes 8 bytes of memory, the offset of its line.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from typing import BinaryIO, Final

from gateway.client import manifest
from gateway.client.manifest import SampleRecord
from gateway.datasets.job import Job

_ABSENT: Final = -1


class Journal:
    """Appends samples to a file, and reads their lines in the order of the job."""

    def __init__(self, job: Job, file: BinaryIO) -> None:
        """
        Args:
            file: open for reading and writing, empty.
        """
        self._job = job
        self._file = file
        self._end = 0
        self._offsets = array("q", [_ABSENT]) * job.size
        self.count = 0

    def has(self, number: int) -> bool:
        """Return whether the sample with this number is finished."""
        return self._offsets[number] != _ABSENT

    def add(self, sample: SampleRecord) -> None:
        """Append a sample; it replaces an earlier one with the same id."""
        planned = self._job.find(sample.id)
        assert planned is not None
        self.count += not self.has(planned.number)
        self._offsets[planned.number] = self._end
        self._end += self._file.write(manifest.encode(sample) + b"\n")

    def flush(self) -> None:
        """Write buffered lines, so that they survive the end of this process."""
        self._file.flush()

    def lines(self) -> Iterator[bytes]:
        """Iterate over the lines of all samples in the order of the job."""
        self._file.flush()
        for offset in self._offsets:
            if offset != _ABSENT:
                if self._file.tell() != offset:
                    self._file.seek(offset)
                yield self._file.readline()
        self._file.seek(self._end)
