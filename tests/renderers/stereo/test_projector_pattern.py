"""Soft dots of the projector."""

import numpy as np
import pytest

from renderers.stereo.light.projector_pattern import SPECKLE_CONTRAST, soft_pattern_levels


def test_soft_dots_have_soft_edges_and_speckle_of_each_camera() -> None:
    left, right = (soft_pattern_levels(right=right)[0].astype(float) for right in (False, True))
    lit = np.minimum(left, right) > 100
    ratio = left[lit] / right[lit]
    assert ratio.std() == pytest.approx(SPECKLE_CONTRAST * np.sqrt(2), rel=0.2)
    assert np.corrcoef(left.ravel(), right.ravel())[0, 1] > 0.9, "the same dots"
    # The mean profile of dots on dark ground: half the light one texel (1.5 pixels at full resolution) beside the
    # centre, none two texels beside it.
    mean = (left + right) / 2
    around = np.lib.stride_tricks.sliding_window_view(mean[:, :1023], 7, axis=1)
    centre, outer = around[..., 3], np.maximum(around[..., 0], around[..., 6])
    peaks = around[(centre > 90) & (outer < 3) & (centre == around.max(axis=-1))]
    assert len(peaks) > 300
    profile = peaks.mean(axis=0)
    profile /= profile[3]
    assert profile[[2, 4]] == pytest.approx([0.5, 0.5], abs=0.12)
    assert profile[[1, 5]].max() < 0.15
