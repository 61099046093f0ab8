"""Error and confidence of matches by texture, agreement and surroundings."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.depth import match_confidence
from renderers.stereo.depth.match_confidence import (
    BINS,
    BORDERS,
    ERROR_FEATURES,
    FEATURES,
    error_and_confidence,
    match_features,
    tables,
)

HEIGHT, WIDTH, SHIFT = 64, 96, 8
SIGMA = 0.3


def texture(contrast: float) -> NDArray[np.uint16]:
    """Return noise of a standard deviation in grey levels, units of 1/16 level."""
    noise = np.random.default_rng(5).normal(128.0, contrast, (HEIGHT, WIDTH))
    return np.rint(np.clip(noise, 0.0, 255.0) * 16).astype(np.uint16)


def judged(left: NDArray[np.uint16], right: NDArray[np.uint16], disparity: int) -> tuple[float, float]:
    """Return the mean error, pixels, and the mean confidence of a constant disparity away from the image's edges."""
    matches = np.full(left.shape, disparity * 16, np.uint16)
    error, confidence = error_and_confidence(match_features(left, right, matches, SIGMA), matches)
    inside = np.s_[24:-24, 36:-24]
    return float(error[inside].mean()) / 16, float(confidence[inside].mean()) / 255


def test_right_matches_of_good_texture_are_confident_and_precise() -> None:
    left = texture(20.0)
    error, confidence = judged(left, np.roll(left, -SHIFT, axis=1), SHIFT)
    assert confidence > 0.95
    assert error < 0.3


def test_matches_that_the_images_contradict_are_not() -> None:
    left = texture(20.0)
    right = np.roll(left, -SHIFT, axis=1)
    assert judged(left, right, SHIFT + 5)[1] < judged(left, right, SHIFT)[1] - 0.1


def test_matches_without_texture_are_less_confident_and_less_precise() -> None:
    plain, textured = texture(0.0), texture(20.0)
    plain_error, plain_confidence = judged(plain, plain, SHIFT)
    error, confidence = judged(textured, np.roll(textured, -SHIFT, axis=1), SHIFT)
    assert plain_confidence < confidence - 0.2
    assert plain_error > error


def test_texture_outside_the_window_counts() -> None:
    """A plain stripe between textures guides the matcher better than a plain wall."""
    striped = texture(20.0)
    striped[:, 40:56] = 128 * 16
    matches = np.full(striped.shape, SHIFT * 16, np.uint16)
    features = dict(zip(FEATURES, match_features(striped, np.roll(striped, -SHIFT, 1), matches, SIGMA), strict=True))
    assert features["texture"][32, 48] < 1.0
    assert features["wide_texture"][32, 48] > 10.0


def test_pixels_without_a_match_have_neither() -> None:
    left = texture(20.0)
    matches = np.full(left.shape, SHIFT * 16, np.uint16)
    matches[10:20, 30:50] = 0
    error, confidence = error_and_confidence(match_features(left, left, matches, SIGMA), matches)
    assert (error[matches == 0] == 0).all()
    assert (confidence[matches == 0] == 0).all()
    assert (error[matches > 0] > 0).all()


def test_disparities_beyond_the_image_are_compared_with_its_edge() -> None:
    left = texture(20.0)
    matches = np.full(left.shape, 65535, np.uint16)
    assert np.isfinite(match_features(left, left, matches, SIGMA)).all()


def test_tables_fit_the_features() -> None:
    weights, errors = tables()
    assert list(BORDERS) == list(FEATURES)
    assert set(ERROR_FEATURES) < set(FEATURES)
    assert weights.shape == (len(FEATURES), BINS)
    assert errors.shape == (BINS, BINS)
    assert errors.min() >= 1
    assert match_confidence.FILE.is_file()
