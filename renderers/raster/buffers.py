"""Output arrays and working memory of a frame, aligned for vectors."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from renderers.compiler.pointers import address_of

CACHE_LINE: Final = 64


def aligned(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return an uninitialised C-contiguous array that begins with a cache line.

    NumPy's own arrays begin 16 bytes after one: every second vector would straddle two lines and take twice the time.
    """
    nbytes = math.prod(shape) * np.dtype(dtype).itemsize
    raw = np.empty(nbytes + CACHE_LINE, np.uint8)
    skipped = -address_of(raw, np.uint8) % CACHE_LINE
    return raw[skipped : skipped + nbytes].view(dtype).reshape(shape)


class Buffers:
    """Arrays that kernels use by address. They live as long as this object."""

    def __init__(self) -> None:
        self._arrays: list[NDArray[Any]] = []

    def allocate(self, count: int, dtype: type[np.generic]) -> tuple[NDArray[Any], int]:
        """Return an uninitialised flat array and its address."""
        array = aligned((count,), dtype)
        self._arrays.append(array)
        return array, address_of(array, dtype)
