"""Front-to-back order of a band's primitives."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from renderers.compiler.pointers import i32_at
from renderers.raster.depth_sort import BUCKETS, count_primitives, front_to_back
from renderers.raster.layout import BINNED, CHUNK, FRAME, MAX_BINS
from renderers.stop import current_stop

frame_at = FRAME.at
BANDS = 2


@njit(error_model="numpy")
def _sort(frame, band, scratch, out):  # type: ignore[no-untyped-def]
    count = count_primitives(frame_at(frame), band)
    indices, keys = i32_at(scratch), i32_at(scratch + 4 * count)
    return count, front_to_back(frame_at(frame), band, indices, keys, i32_at(scratch + 8 * count), i32_at(out))


def ordered(inv_z: NDArray[np.float32], band: int) -> list[int]:
    """Sort primitives of three chunks: each has two bins of four and one tall primitive; the second misses band 1."""
    chunks = 3
    binned = np.zeros(chunks * CHUNK, BINNED.dtype)
    bins, tall = np.zeros((chunks, MAX_BINS * CHUNK), np.uint16), np.zeros((chunks, CHUNK), np.uint16)
    starts, bands = np.zeros((chunks, 2 * BANDS + 4), np.int32), np.zeros((chunks, 4), np.int32)
    binned["inv_z_max"].reshape(chunks, CHUNK)[:, :9] = inv_z
    bins[:, :8] = np.arange(8)
    tall[:, 0] = 8
    starts[:, :3], starts[:, -2:] = (0, 4, 8), (1, 1)
    bands[:, :2] = (0, 1)
    bands[1, :2] = (0, 0)
    frame = np.zeros(1, FRAME.dtype)
    frame["band_count"] = frame["bin_count"] = BANDS
    frame["chunk_count"] = chunks
    for name, array in (("binned", binned), ("bins", bins), ("tall", tall)):
        frame[name] = array.ctypes.data
    frame["bin_starts"], frame["chunk_bands"] = starts.ctypes.data, bands.ctypes.data
    frame["stop"] = current_stop().address
    scratch, out = np.zeros(BUCKETS + 100, np.int32), np.zeros(100, np.int32)
    counted, count = _sort(frame.ctypes.data, band, scratch.ctypes.data, out.ctypes.data)
    assert counted == count
    return list(map(int, out[:count]))


def members(band: int) -> list[int]:
    return [
        CHUNK * chunk + k for chunk in range(3) if (chunk, band) != (1, 1) for k in (*range(4 * band, 4 * band + 4), 8)
    ]


def test_nearest_first_and_each_once() -> None:
    inv_z = 2.0 ** np.random.default_rng(0).permutation(27).astype(np.float32).reshape(3, 9)
    for band in range(BANDS):
        got = ordered(inv_z, band)
        assert sorted(got) == sorted(members(band))
        values = [inv_z[index // CHUNK, index % CHUNK] for index in got]
        assert values == sorted(values, reverse=True)


def test_equal_depths_keep_their_order() -> None:
    for value in (1.0, 0.0, -1.0, np.inf):
        assert ordered(np.full((3, 9), value, np.float32), 1) == members(1)


def test_negative_depths_come_last() -> None:
    inv_z = np.full((3, 9), -1.0, np.float32)
    inv_z[2, 2] = 0.5
    assert ordered(inv_z, 0)[0] == 2 * CHUNK + 2
