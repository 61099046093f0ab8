"""Statistics of the fixed pattern."""

import numpy as np
import pytest

from renderers.stereo.sensor.camera_image import (
    COLUMN_OFFSET,
    GAIN_UNIT,
    OFFSET_UNIT,
    PIXEL_GAIN,
    PIXEL_OFFSET,
    fixed_pattern,
)


def test_fixed_pattern_is_fixed_and_has_its_statistics() -> None:
    left, again = (fixed_pattern(3, right=False, height=480, width=640) for _ in range(2))
    assert (left.offset == again.offset).all()
    right, other = (fixed_pattern(seed, right=right, height=480, width=640) for seed, right in ((3, True), (4, False)))
    for each in (right, other):
        assert abs(np.corrcoef(left.offset.ravel(), each.offset.ravel())[0, 1]) < 0.1  # columns are few
    offset, gain = left.offset * OFFSET_UNIT, left.gain * GAIN_UNIT
    assert offset.std() == pytest.approx(np.hypot(PIXEL_OFFSET, COLUMN_OFFSET), rel=0.05)
    assert offset.mean(axis=0).std() == pytest.approx(COLUMN_OFFSET, rel=0.15)
    assert gain.std() == pytest.approx(PIXEL_GAIN, rel=0.05)
