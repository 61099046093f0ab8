"""Counter-based random numbers: what a pixel draws depends on (seed, frame, stream, pixel) and on nothing else.

So the same frame has the same bytes however it is cut into threads, and no state has to be kept.
"""

from __future__ import annotations

from enum import IntEnum
from statistics import NormalDist
from typing import Any, Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

_MASK64: Final = (1 << 64) - 1
KERNELS_VERSION: Final = 1
"""Numba caches by the content of each file, not of what it imports: files with kernels that call ours name this."""


class Stream(IntEnum):
    """Independent sequences within one frame."""

    LEFT = 1
    RIGHT = 2
    LEFT_DEPTH = 3
    RIGHT_DEPTH = 4
    DISPARITY = 5
    LEFT_SECOND = 6
    RIGHT_SECOND = 7

    @property
    def right(self) -> bool:
        """Whether it is the right camera's."""
        return self in (Stream.RIGHT, Stream.RIGHT_DEPTH, Stream.RIGHT_SECOND)


def frame_key(seed: int, frame: int, stream: Stream) -> np.uint64:
    """A 64-bit key for one stream of one frame (splitmix64 over the three numbers)."""
    state = 0
    for value in (seed, frame, int(stream)):
        state = (state ^ (value & _MASK64)) + 0x9E3779B97F4A7C15 & _MASK64
        state = (state ^ state >> 30) * 0xBF58476D1CE4E5B9 & _MASK64
        state = (state ^ state >> 27) * 0x94D049BB133111EB & _MASK64
        state ^= state >> 31
    return np.uint64(state)


@njit(inline="always")
def random64(key: Any, counter: Any) -> Any:
    """64 random bits of a counter (splitmix64, Steele et al. 2014)."""
    z = key + np.uint64(counter) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


def _normal_table() -> NDArray[np.float32]:
    normal = NormalDist()
    table = np.array([normal.inv_cdf((i + 0.5) / 4096) for i in range(4096)])
    scaled: NDArray[np.float32] = (table / table.std()).astype(np.float32)
    return scaled


NORMAL_TABLE: Final = _normal_table()
"""(4096,) float32: the standard normal's quantiles, scaled to unit variance; 12 random bits choose one."""
