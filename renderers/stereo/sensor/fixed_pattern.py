"""Fixed-pattern noise of a camera: offsets of pixels and columns and gains of pixels, the same in every frame.

The device's magnitudes are not published. Ours are of the order that data sheets (EMVA 1288) give for CMOS sensors with
global shutter, after the camera's own correction.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import Cache

PIXEL_OFFSET: Final = 0.1
"""Standard deviation of the pixels' offsets at 0 dB, grey levels. Offsets are amplified by the gain."""
COLUMN_OFFSET: Final = 0.08
"""Standard deviation of the columns' offsets at 0 dB, grey levels."""
PIXEL_GAIN: Final = 0.004
"""Standard deviation of the pixels' gains, relative (PRNU)."""
OFFSET_UNIT: Final = 1.0 / 128.0
"""Grey levels at 0 dB per unit of ``FixedPattern.offset``."""
GAIN_UNIT: Final = 1.0 / 4096.0
"""Relative light per unit of ``FixedPattern.gain``."""


@dataclass(frozen=True, slots=True, eq=False)
class FixedPattern:
    """Fixed pattern of one sensor."""

    offset: NDArray[np.int8]
    """(H, W) int8, units of ``OFFSET_UNIT``."""
    gain: NDArray[np.int8]
    """(H, W) int8, units of ``GAIN_UNIT``; 0: the mean gain."""


_cached_patterns: Cache[tuple[int, bool, int, int], FixedPattern] = Cache("fixed_patterns")


def fixed_pattern(seed: int, *, right: bool, height: int, width: int) -> FixedPattern:
    """Return the pattern of a sensor, from the cache if possible. It depends on the arguments only.

    Args:
        seed: seed of the stereo camera.
        right: the right sensor instead of the left one.
        height: rows.
        width: columns.
    """
    key = (seed, right, height, width)
    pattern = _cached_patterns.get(key)
    if pattern is None:
        pattern = _make_pattern(*key)
        _cached_patterns.put(key, pattern, pattern.offset.nbytes + pattern.gain.nbytes)
    return pattern


def _make_pattern(seed: int, right: bool, height: int, width: int) -> FixedPattern:
    random = np.random.Generator(np.random.Philox(key=(seed << 1 | int(right)) & (2**128 - 1)))

    def normal(*shape: int) -> NDArray[np.float64]:
        """Return approximately normal numbers from sums of four bytes: equal on every CPU, unlike a logarithm."""
        total = random.integers(0, 256, (4, *shape), np.uint8).sum(axis=0, dtype=np.int64)
        # The sum has the mean 4 * 127.5 and the standard deviation sqrt(4 * (256**2 - 1) / 12).
        numbers: NDArray[np.float64] = (total - 510.0) / 147.8
        return numbers

    def to_int8(values: NDArray[np.float64]) -> NDArray[np.int8]:
        return np.clip(np.rint(values), -127, 127).astype(np.int8)

    offset = PIXEL_OFFSET * normal(height, width) + COLUMN_OFFSET * normal(width)
    return FixedPattern(to_int8(offset / OFFSET_UNIT), to_int8(PIXEL_GAIN / GAIN_UNIT * normal(height, width)))
