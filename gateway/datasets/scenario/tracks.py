"""Reads tracks: CSV files with a column ``time`` in seconds and columns of numbers, between which values are linear."""

import csv
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.datasets.scenario.tables import MAX_METRES, ScenarioError
from gateway.files.gltf.animations import slerp
from gateway.scene.tree.transforms import Matrix, from_pose
from scenegate.regular_files import errors_as, read_text

MAX_TRACK_BYTES: Final = 64 << 20
"""Maximum size of a track. An hour of 20 joints at 100 Hz has 60 MB."""
POSE_COLUMNS: Final = ("x", "y", "z", "qw", "qx", "qy", "qz")
"""Columns of a track of poses: metres, and a quaternion."""
QUATERNION_NORMS: Final = (1e-3, 1e3)
"""Lengths that a quaternion may have; it is normalised."""


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
        """Return the pose at a time, (4, 4), of a track that was read with ``poses``."""
        row = float(np.interp(seconds, self.times, np.arange(len(self.values))))
        index = int(row)
        fraction = row - index
        begin, end = self.values[index], self.values[min(index + 1, len(self.values) - 1)]
        position = (1.0 - fraction) * begin[:3] + fraction * end[:3]
        begin_quaternion, end_quaternion = (pose[3:] / np.linalg.norm(pose[3:]) for pose in (begin, end))
        return from_pose(position.tolist(), slerp(begin_quaternion, end_quaternion, fraction).tolist())


def read_track(path: Path, *, poses: bool) -> Track:
    """Read a track, or return it from the cache if its file has not changed. Raises ScenarioError with the line.

    ``poses``: the columns must be ``POSE_COLUMNS``, whose order the track has.
    """
    with errors_as(ScenarioError, path, UnicodeDecodeError):
        status = path.stat()
        return _read_cached(path, poses, status.st_mtime_ns, status.st_size)


@lru_cache(16)
def _read_cached(path: Path, poses: bool, modified_ns: int, size: int) -> Track:
    """Read a track. The time and size of its file are part of the cache's key."""
    reader = csv.reader(read_text(path, MAX_TRACK_BYTES).splitlines())
    rows: list[list[float]] = []
    lines: list[int] = []
    try:
        header = [name.strip() for name in next(reader, [])]
        if header[:1] != ["time"] or len(header) < 2 or len(set(header)) < len(header):
            raise ScenarioError(f"{path}: line 1: it must be time and the names of other columns, separated by commas")
        for fields in filter(None, reader):
            try:
                row = [float(field) for field in fields]
            except ValueError:
                row = []
            if len(row) != len(header) or not np.isfinite(row).all() or (rows and row[0] < rows[-1][0]):
                reason = f"it must be {len(header)} finite numbers, the time not before the last"
                raise ScenarioError(f"{path}: line {reader.line_num}: {reason}")
            rows.append(row)
            lines.append(reader.line_num)
    except csv.Error as error:  # a field is too long
        raise ScenarioError(f"{path}: line {reader.line_num}: {error}") from None
    if not rows:
        raise ScenarioError(f"{path}: it has no row after the names of the columns")
    numbers = np.array(rows)
    if not poses:
        return Track(tuple(header[1:]), numbers[:, 0], numbers[:, 1:])
    if sorted(header[1:]) != sorted(POSE_COLUMNS):
        raise ScenarioError(f"{path}: line 1: the columns are not time,{','.join(POSE_COLUMNS)}")
    values = numbers[:, [header.index(name) for name in POSE_COLUMNS]]
    _check_poses(path, values, lines)
    return Track(POSE_COLUMNS, numbers[:, 0], values)


def _check_poses(path: Path, values: NDArray[np.float64], lines: list[int]) -> None:
    """Raise ScenarioError if a position or quaternion, (N, 7), is beyond the limits; ``lines`` are the rows' lines."""
    min_norm, max_norm = QUATERNION_NORMS
    norms = np.hypot.reduce(values[:, 3:], axis=1)
    is_far = np.abs(values[:, :3]).max(axis=1) > MAX_METRES
    is_bad = is_far | (norms < min_norm) | (norms > max_norm)
    if is_bad.any():
        row = int(is_bad.argmax())
        if is_far[row]:
            reason = f"a coordinate must be from -{MAX_METRES} to {MAX_METRES} m, not {values[row, :3].tolist()}"
        else:
            reason = f"the length of a quaternion must be from {min_norm:g} to {max_norm:g}, not {norms[row]:g}"
        raise ScenarioError(f"{path}: line {lines[row]}: {reason}")
