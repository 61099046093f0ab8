"""The device's post-processing of disparity images: minconf, depth range, maxdeptherr, seg and fill."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F64, I64, U16, Array1, Array2, i32
from renderers.stereo.depth.depth_images import DepthImages, DepthRange
from renderers.stereo.model import DISPARITY_SCALE, StereoModel

SEGMENT_STEP: Final = 2.0
"""Maximum disparity step between neighbours of one segment, pixels (as in the vendor's drivers)."""
FULL_SEGMENT_STEP: Final = 6.0
"""The same at Full, whose pixels are half as large, and are matched without a window."""
FILL_SHARE: Final = 0.05
"""Maximum share of the pixels that are filled, the smallest holes first (manual)."""
FILL_CONFIDENCE: Final = 128
"""Confidence of filled pixels, units of 1/255: 0.5 (manual)."""
_MAX_UNITS: Final = 32767
"""Maximum disparity, units of 1/16 pixel."""
_AT_IMAGE_EDGE: Final = -1_000_000
"""Stored as the lowest border disparity of holes at the edge of the image, which makes their range too large to be
filled."""
_ROW, _START, _END, _FIRST = range(4)
"""Columns of ``_connected_runs``."""


@dataclass(frozen=True, slots=True)
class Filters:
    """The device's parameters of the same names, in the device's units."""

    minconf: float = 0.5
    """Minimum confidence, 0 to 1."""
    seg: int = 200
    """Minimum size of a segment, pixels of an image in High quality."""
    fill: int = 3
    """Maximum disparity step on the border of a hole that is filled, pixels; 0 disables filling."""
    maxdeptherr: float = 100.0
    """Maximum depth error, metres: ``disparity_error Z^2 / (f t)`` with depth Z, focal length f and baseline t."""
    mindepth: float = 0.1
    """Minimum depth, metres."""
    maxdepth: float = 100.0
    """Maximum depth, metres."""

    @property
    def fills(self) -> bool:
        """True if holes are filled: filling is enabled, and ``minconf`` permits the confidence of filled pixels."""
        return self.fill > 0 and self.min_confidence <= FILL_CONFIDENCE

    @property
    def min_confidence(self) -> int:
        """``minconf`` in units of a confidence image, 1/255."""
        return int(np.ceil(self.minconf * 255.0 - 1e-9))

    def measurable_depths(self, model: StereoModel, divisor: int) -> DepthRange:
        """Return the range of depths that a camera can measure at 1/``divisor`` of the resolution."""
        return DepthRange(model.nearest_depth(self.mindepth, self.maxdepth, divisor), self.maxdepth)


def apply_filters(depth: DepthImages, filters: Filters, focal_times_baseline: float, divisor: int) -> None:
    """Remove and fill pixels in place, in the device's order: confidence and range, segments, holes."""
    unit = DISPARITY_SCALE
    min_units = max(int(np.ceil(focal_times_baseline / filters.maxdepth / unit - 1e-9)), 1)
    max_units = min(int(np.floor(focal_times_baseline / filters.mindepth / unit + 1e-9)), _MAX_UNITS)
    _apply_limits(
        depth.disparity, depth.error, depth.confidence, filters.min_confidence, min_units, max_units,
        float(focal_times_baseline / unit), float(filters.maxdeptherr),
    )  # fmt: skip
    min_size = round(filters.seg * 4 / divisor**2)
    if min_size > 1:
        runs = _connected_runs(
            depth.disparity, round((FULL_SEGMENT_STEP if divisor == 1 else SEGMENT_STEP) / DISPARITY_SCALE)
        )
        _remove_small(runs, min_size, depth.disparity, depth.error, depth.confidence)
    if filters.fills:
        fill_holes(depth, filters.fill)


@kernel
def _apply_limits(
    disparity: Array2[np.uint16],
    error: Array2[np.uint8],
    confidence: Array2[np.uint8],
    min_confidence: I64,
    min_disparity: I64,
    max_disparity: I64,
    depth_error_factor: F64,
    max_depth_error: F64,
) -> None:
    """Remove pixels beyond the limits; disparities and their limits are in units of 1/16 pixel.

    The depth error in metres is ``depth_error_factor * error / disparity^2``, with error and disparity in the units of
    their images.
    """
    height, width = disparity.shape
    for row in range(height):
        for column in range(width):
            units = float(disparity[row, column])
            if (
                confidence[row, column] < min_confidence
                or units < min_disparity
                or units > max_disparity
                or float(error[row, column]) * depth_error_factor > max_depth_error * units * units
            ):
                disparity[row, column] = 0
                error[row, column] = 0
                confidence[row, column] = 0


def fill_holes(depth: DepthImages, max_step: int) -> None:
    """Fill holes in place, the smallest first, up to ``FILL_SHARE`` of the pixels.

    ``max_step`` is the maximum difference of the disparities on a hole's border, pixels.
    """
    disparity = depth.disparity
    runs = _connected_runs(disparity, _MAX_UNITS)
    # Arrays by first run of a hole: its size, and the lowest and highest disparity on its border.
    size = np.zeros(len(runs), np.int32)
    lowest = np.full(len(runs), 65536, np.int32)
    highest = np.full(len(runs), -1, np.int32)
    _measure_holes(runs, disparity, size, lowest, highest)
    fillable = np.flatnonzero((highest >= 0) & (highest - lowest <= round(max_step / DISPARITY_SCALE)))
    smallest_first = fillable[np.argsort(size[fillable], kind="stable")]
    is_filled = np.zeros(len(runs), np.bool_)
    is_filled[smallest_first[np.cumsum(size[smallest_first]) <= FILL_SHARE * disparity.size]] = True
    _fill_runs(runs, is_filled, disparity, depth.error, depth.confidence)


def _connected_runs(disparity: NDArray[np.uint16], max_step: int) -> NDArray[np.int32]:
    """Return the connected segments and holes of a disparity image as runs along rows, (N, 4) int32 in raster order.

    Columns are ``_ROW``, ``_START`` and ``_END`` of a run, and ``_FIRST``, the first run of its segment or hole.
    Neighbours of one segment differ by at most ``max_step``, units of 1/16 pixel.
    """
    runs = np.empty((disparity.size, 4), np.int32)
    return runs[: _find_runs(disparity, max_step, runs)]


@inlined
def _is_connected(one: U16, other: U16, max_step: I64) -> bool:
    """Return True for two neighbours that are both holes, or valid with a step of at most ``max_step``."""
    return (one == 0) == (other == 0) and abs(i32(one) - i32(other)) <= max_step


@device_function
def _first_run(runs: Array2[np.int32], run: I64) -> I64:
    """Return the first run that is known to be connected to a run, and shorten the path to it."""
    while runs[run, _FIRST] != run:
        runs[run, _FIRST] = runs[runs[run, _FIRST], _FIRST]
        run = runs[run, _FIRST]
    return run


@kernel
def _find_runs(disparity: Array2[np.uint16], max_step: I64, runs: Array2[np.int32]) -> I64:
    """Write ``_connected_runs`` and return their number."""
    height, width = disparity.shape
    # Flags of the columns at which a run of the row ends. Eight of them are skipped at once if none is set.
    ends = np.zeros((width // 8 + 1) * 8, np.bool_)
    ends[width] = True
    words = ends.view(np.uint64)
    count = above = 0  # runs so far; first run of the row above that may touch the next one
    for row in range(height):
        for column in range(1, width):
            ends[column] = not _is_connected(disparity[row, column - 1], disparity[row, column], max_step)
        row_start, start = count, 0
        for word in range(len(words)):
            if words[word] == 0:
                continue
            for end in range(word * 8, word * 8 + 8):
                if not ends[end]:
                    continue
                runs[count, _ROW], runs[count, _START], runs[count, _END], runs[count, _FIRST] = row, start, end, count
                while above < row_start and runs[above, _START] < end:
                    _join(disparity, max_step, runs, above, count)
                    if runs[above, _END] > end:
                        break
                    above += 1
                start = end
                count += 1
        above = row_start
    for run in range(count):
        runs[run, _FIRST] = _first_run(runs, run)
    return count


@device_function
def _join(disparity: Array2[np.uint16], max_step: I64, runs: Array2[np.int32], above: I64, below: I64) -> None:
    """Connect two runs of successive rows if neighbours are connected where they overlap."""
    row = runs[below, _ROW]
    for column in range(max(runs[above, _START], runs[below, _START]), min(runs[above, _END], runs[below, _END])):
        if _is_connected(disparity[row - 1, column], disparity[row, column], max_step):
            one, other = _first_run(runs, above), _first_run(runs, below)
            runs[max(one, other), _FIRST] = min(one, other)
            return


@kernel
def _remove_small(
    runs: Array2[np.int32],
    min_size: I64,
    disparity: Array2[np.uint16],
    error: Array2[np.uint8],
    confidence: Array2[np.uint8],
) -> None:
    """Remove the segments of fewer than ``min_size`` pixels; ``runs``: ``_connected_runs``."""
    size = np.zeros(len(runs), np.int32)
    for run in range(len(runs)):
        size[runs[run, _FIRST]] += runs[run, _END] - runs[run, _START]
    for run in range(len(runs)):
        if size[runs[run, _FIRST]] < min_size:
            row = runs[run, _ROW]
            for column in range(runs[run, _START], runs[run, _END]):
                disparity[row, column], error[row, column], confidence[row, column] = 0, 0, 0


@kernel
def _measure_holes(
    runs: Array2[np.int32],
    disparity: Array2[np.uint16],
    size: Array1[np.int32],
    lowest: Array1[np.int32],
    highest: Array1[np.int32],
) -> None:
    """Write the size of every hole, pixels, and the range of the disparities on its border, by first run.

    ``size`` is 0 at first, ``lowest`` above all disparities, and ``highest`` -1.
    """
    height, width = disparity.shape
    for run in range(len(runs)):
        row, start, end, hole = runs[run, _ROW], runs[run, _START], runs[run, _END], runs[run, _FIRST]
        if disparity[row, start] != 0:
            continue
        size[hole] += end - start
        if row == 0 or start == 0 or row == height - 1 or end == width:
            lowest[hole] = _AT_IMAGE_EDGE
            continue
        low, high = lowest[hole], highest[hole]
        for neighbour in (disparity[row, start - 1], disparity[row, end]):
            low, high = min(low, neighbour), max(high, neighbour)
        for column in range(start, end):
            for neighbour in (disparity[row - 1, column], disparity[row + 1, column]):
                if neighbour != 0:
                    low, high = min(low, neighbour), max(high, neighbour)
        lowest[hole], highest[hole] = low, high


@kernel
def _fill_runs(
    runs: Array2[np.int32],
    is_filled: Array1[np.bool_],
    disparity: Array2[np.uint16],
    error: Array2[np.uint8],
    confidence: Array2[np.uint8],
) -> None:
    """Fill the runs of the holes with ``is_filled[first run]`` linearly between the valid pixels left and right.

    Those pixels exist, because holes at the edge of the image are not filled.
    """
    for run in range(len(runs)):
        if not is_filled[runs[run, _FIRST]]:
            continue
        row, start, end = runs[run, _ROW], runs[run, _START], runs[run, _END]
        left, right = float(disparity[row, start - 1]), float(disparity[row, end])
        larger_error = max(error[row, start - 1], error[row, end])
        for column in range(start, end):
            fraction = (column - start + 1.0) / (end - start + 1.0)
            disparity[row, column] = int(left + (right - left) * fraction + 0.5)
            error[row, column] = larger_error
            confidence[row, column] = FILL_CONFIDENCE
