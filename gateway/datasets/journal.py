"""The journal of a run: a file with one line per finished sample, in the order in which the samples finish.

``run`` writes it, and then copies it to the manifest in the order of the job. A run may have millions of samples. Each
takes 8 bytes of memory, the offset of its line.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator
from typing import BinaryIO, Final

from gateway.datasets.job import Job
from scenegate.datasets import manifest
from scenegate.datasets.manifest import SampleRecord

_ABSENT: Final = -1
"""Offset of a sample that is not in the journal."""


class Journal:
    """Appends samples to a file, and reads their lines in the order of the job."""

    def __init__(self, job: Job, file: BinaryIO) -> None:
        """Create an empty journal.

        Args:
            file: empty file, open for reading and writing.
        """
        self._job = job
        self._file = file
        self._end_offset = 0
        self._offsets = array("q", [_ABSENT]) * job.size
        """Offset of each sample's line in bytes, by the number of the sample."""
        self.count = 0
        """Number of different samples that were added."""

    def has_sample(self, number: int) -> bool:
        """Return True if the sample with a number was added."""
        return self._offsets[number] != _ABSENT

    def add(self, sample: SampleRecord) -> None:
        """Append a sample. It replaces an earlier sample with the same id."""
        planned = self._job.find(sample.id)
        assert planned is not None
        if not self.has_sample(planned.number):
            self.count += 1
        self._offsets[planned.number] = self._end_offset
        self._end_offset += self._file.write(manifest.encode(sample) + b"\n")

    def flush(self) -> None:
        """Write buffered lines to the file, so that they are not lost if this process is killed."""
        self._file.flush()

    def lines_in_job_order(self) -> Iterator[bytes]:
        """Yield the lines of all samples."""
        self._file.flush()
        try:
            for offset in self._offsets:
                if offset != _ABSENT:
                    if self._file.tell() != offset:
                        self._file.seek(offset)
                    yield self._file.readline()
        finally:
            self._file.seek(self._end_offset)  # where ``add`` goes on
