"""Units of work of a frame."""

import pytest

from renderers.visibility_buffer import band_count


@pytest.mark.parametrize(("height", "bands"), [(0, 0), (1, 1), (32, 1), (33, 2), (64, 2), (65, 3)])
def test_band_count(height: int, bands: int) -> None:
    assert band_count(height) == bands
