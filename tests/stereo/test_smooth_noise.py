"""Correlated noise: variance, correlation, and equal bytes everywhere."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest

from renderers.stereo.smooth_noise import smooth_noise

DIGEST = "dee0228db11e379c7d89cdf4a6048fcd9a383131ec48e46775f96ba5a7d7180f"


@pytest.mark.parametrize("box", [1, 2, 5, 19])
def test_variance_is_1_and_the_correlation_that_of_two_boxes(box: int) -> None:
    noise = smooth_noise(600, 800, box, np.uint64(5))
    assert noise.dtype == np.float32
    assert abs(noise.mean()) < 0.15
    assert noise.std() == pytest.approx(1.0, rel=0.08)
    for shifted, still in ((noise[:, box:], noise[:, :-box]), (noise[box:], noise[:-box])):
        weights = np.convolve(np.ones(box), np.ones(box))
        expected = (weights[box:] @ weights[: len(weights) - box]) / (weights @ weights)
        assert np.corrcoef(shifted.reshape(-1), still.reshape(-1))[0, 1] == pytest.approx(expected, abs=0.06)
    # Corners are as noisy as the middle.
    corners = [smooth_noise(9, 9, box, np.uint64(key))[0, 0] for key in range(400)]
    assert np.std(corners) == pytest.approx(1.0, rel=0.15)


def test_keys_give_independent_noise() -> None:
    one, other = (smooth_noise(300, 400, 4, np.uint64(key)) for key in (1, 2))
    assert abs(np.corrcoef(one.reshape(-1), other.reshape(-1))[0, 1]) < 0.05


def test_bytes_are_the_same_on_every_machine() -> None:
    digest = hashlib.sha256(smooth_noise(40, 50, 6, np.uint64(3)).tobytes()).hexdigest()
    assert digest == DIGEST
