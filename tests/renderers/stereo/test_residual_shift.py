"""Sub-pixel shift that remains at given disparities."""

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.stereo.depth.residual_shift import MAX_RADIUS, residual_shift


def waves(shift: float, shape: tuple[int, int] = (60, 200)) -> NDArray[np.uint16]:
    """Return a sum of waves that is moved to the right by ``shift`` pixels, (H, W) uint16, units of 1/16 level."""
    rows, columns = np.mgrid[0 : shape[0], 0 : shape[1]].astype(np.float64)
    x = columns - shift
    image = 128 + 40 * np.sin(x / 1.7 + rows / 3) + 30 * np.sin(x / 2.9 - rows / 5) + 20 * np.sin(x / 4.3 + rows)
    levels: NDArray[np.uint16] = np.rint(image * 16).astype(np.uint16)
    return levels


@pytest.mark.parametrize("shift", [-0.4, -0.1, 0.0, 0.2, 0.4])
@pytest.mark.parametrize("disparity", [12.0, 12.25, 12.5, 12.8])
def test_the_shift_of_a_textured_pair_is_found(shift: float, disparity: float) -> None:
    left, right = waves(disparity + shift), waves(0.0)
    given = np.full(left.shape, disparity, np.float32)
    found = residual_shift(left, right, given, 4, 0.3)[10:-10, 30:-10]
    assert found.mean() == pytest.approx(shift, abs=0.02 + 0.15 * abs(shift))
    for _ in range(2):
        given += found.mean()
        found = residual_shift(left, right, given, 4, 0.3)[10:-10, 30:-10]
    assert abs(found.mean()) < 0.02


def test_windows_without_texture_have_no_shift() -> None:
    grey = np.full((30, 80), 1600, np.uint16)
    disparity = np.full(grey.shape, 7.5, np.float32)
    assert (residual_shift(grey, grey, disparity, 3, 0.3) == 0).all()


def test_unknown_disparities_have_no_shift_and_do_not_count() -> None:
    left, right = waves(12.3), waves(0.0)
    disparity = np.full(left.shape, 12.0, np.float32)
    expected = residual_shift(left, right, disparity, 2, 0.3)
    disparity[:, 100:] = 0.0
    left[:, 100 + 1 :] = 4080  # a gradient reaches one pixel beyond
    found = residual_shift(left, right, disparity, 2, 0.3)
    assert (found[:, 100:] == 0).all()
    np.testing.assert_array_equal(found[:, :97], expected[:, :97])


def test_extreme_levels_do_not_overflow() -> None:
    left = np.zeros((40, 60), np.uint16)
    left[:, 1::4] = left[:, 2::4] = 4080
    found = residual_shift(left, 4080 - left, np.full(left.shape, 4.0, np.float32), MAX_RADIUS, 0.0)
    assert np.isfinite(found).all()
    assert np.abs(found).max() < 3.0
