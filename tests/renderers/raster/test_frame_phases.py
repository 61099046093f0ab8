"""Units of work of a frame, and the memory layout of bands."""

from __future__ import annotations

import pytest
from numba import njit

from renderers.raster.frame_phases import unit_rows
from renderers.visibility_buffer import BAND_ROWS, band_count


@njit
def _unit_rows(unit, bands, halved, height):  # type: ignore[no-untyped-def]
    return unit_rows(unit, bands, halved, height)


@pytest.mark.parametrize("halved", [0, 1, 2])
@pytest.mark.parametrize("height", [1, 15, 16, 17, 31, 32, 33, 48, 49, 64, 65, 100, 480, 481])
def test_units_cover_every_row_once_and_stay_in_a_band(height: int, halved: int) -> None:
    bands = band_count(height)
    covered: list[int] = []
    sizes = []
    for unit in range(bands + min(bands, halved)):
        first, end = _unit_rows(unit, bands, halved, height)
        rows = list(range(first, end))
        assert len({row // BAND_ROWS for row in rows}) <= 1
        covered += rows
        sizes.append(len(rows))
    assert covered == list(range(height))
    assert max(sizes[-2 * halved :], default=0) <= (BAND_ROWS // 2 if halved else BAND_ROWS)


@pytest.mark.parametrize(("height", "bands"), [(0, 0), (1, 1), (32, 1), (33, 2), (64, 2), (65, 3)])
def test_band_count(height: int, bands: int) -> None:
    assert band_count(height) == bands
