"""Reads tracks: CSV files with a column ``time`` in seconds and columns of numbers, between which values are linear."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.scenario.tables import ScenarioError
from gateway.gltf.animations import slerp
from gateway.scene.transforms import Matrix, from_pose
from scenegate.regular_files import read_text

MAX_TRACK_BYTES: Final = 64 << 20
"""Maximum size of a track. An hour of 20 joints at 100 Hz has 60 MB."""
POSE_COLUMNS: Final = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Columns of a track of poses: metres, and a quaternion."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Values over time. Before the first row and after the last one they stay."""

    names: tuple[str, ...]
    times: NDArray[np.float64]
    """(N,) float64, seconds, ascending."""
    values: NDArray[np.float64]
    """(N, number of names) float64."""

    def at(self, seconds: float) -> dict[str, tuple[float, ...]]:
        """Return each value at a time, as a tuple of one."""
        numbers = (float(np.interp(seconds, self.times, column)) for column in self.values.T)
        return {name: (number,) for name, number in zip(self.names, numbers, strict=True)}

    def pose_at(self, seconds: float) -> Matrix:
        """Return the pose at a time, (4, 4), of a track with ``POSE_COLUMNS``."""
        columns = self.values[:, [self.names.index(name) for name in POSE_COLUMNS]]
        row = float(np.interp(seconds, self.times, np.arange(len(columns))))
        t = row - int(row)
        begin, end = columns[int(row)], columns[min(int(row) + 1, len(columns) - 1)]
        position = (1.0 - t) * begin[:3] + t * end[:3]
        q_begin, q_end = (q / np.linalg.norm(q) for q in (begin[3:], end[3:]))
        return from_pose(position.tolist(), slerp(q_begin, q_end, t).tolist())


def read_track(path: Path, *, poses: bool) -> Track:
    """Read a track, or return it from the cache if its file has not changed.

    Args:
        poses: the columns must be ``POSE_COLUMNS``.

    Raises:
        ScenarioError: it cannot be read; the message names the line.
    """
    try:
        status = path.stat()
        track = _read_cached(path, status.st_mtime_ns, status.st_size)
    except (OSError, UnicodeDecodeError) as error:
        raise ScenarioError(f"{path}: {getattr(error, 'strerror', None) or error}") from None
    if poses and sorted(track.names) != sorted(POSE_COLUMNS):
        raise ScenarioError(f"{path}: line 1: the columns are not time,{','.join(POSE_COLUMNS)}")
    if poses and not track.values[:, [track.names.index(name) for name in POSE_COLUMNS[3:]]].any(axis=1).all():
        raise ScenarioError(f"{path}: a quaternion is zero")
    return track


@lru_cache(16)
def _read_cached(path: Path, modified_ns: int, size: int) -> Track:
    """Read a track. The time and size of its file are part of the cache's key."""
    reader = csv.reader(read_text(path, MAX_TRACK_BYTES).splitlines())
    header = [name.strip() for name in next(reader, [])]
    if header[:1] != ["time"] or len(header) < 2 or len(set(header)) < len(header):
        raise ScenarioError(f"{path}: line 1: it must be time and the names of other columns, separated by commas")
    rows: list[list[float]] = []
    for fields in reader:
        if not fields:
            continue
        try:
            row = [float(field) for field in fields]
        except ValueError:
            row = []
        if len(row) != len(header) or not np.isfinite(row).all() or (rows and row[0] < rows[-1][0]):
            raise ScenarioError(
                f"{path}: line {reader.line_num}: it must be {len(header)} finite numbers, the time not before the last"
            )
        rows.append(row)
    if not rows:
        raise ScenarioError(f"{path}: it has no row after the names of the columns")
    numbers = np.array(rows)
    return Track(tuple(header[1:]), numbers[:, 0], numbers[:, 1:])
