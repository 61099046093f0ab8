"""Error and confidence of matches by texture, agreement and surroundings."""

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.stereo.depth.match_confidence import (
    ERROR_BORDERS,
    EVEN_NOISE,
    FEATURES,
    TREE_DEPTH,
    error_and_confidence,
    match_features,
    tables,
    with_even_noise,
    with_texture,
)

HEIGHT, WIDTH, SHIFT = 64, 96, 8


def texture(contrast: float) -> NDArray[np.uint16]:
    """Return noise of a standard deviation in grey levels, units of 1/16 level."""
    noise = np.random.default_rng(5).normal(128.0, contrast, (HEIGHT, WIDTH))
    return np.rint(np.clip(noise, 0.0, 255.0) * 16).astype(np.uint16)


def judged(left: NDArray[np.uint16], right: NDArray[np.uint16], disparity: int) -> tuple[float, float]:
    """Return the mean error, pixels, and the mean confidence of a constant disparity away from the image's edges."""
    matches = np.full(left.shape, disparity * 16, np.uint16)
    error, confidence = error_and_confidence(match_features(left, right, matches, 2), matches, 2)
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


def test_matches_of_faint_texture_are_less_confident_and_less_precise() -> None:
    faint, textured = texture(0.4), texture(20.0)
    faint_error, faint_confidence = judged(faint, np.roll(faint, -SHIFT, axis=1), SHIFT)
    error, confidence = judged(textured, np.roll(textured, -SHIFT, axis=1), SHIFT)
    assert faint_confidence < confidence
    assert faint_error > error


def features_of(image: NDArray[np.uint16]) -> dict[str, NDArray[np.float32]]:
    matches = np.full(image.shape, SHIFT * 16, np.uint16)
    return dict(zip(FEATURES, match_features(image, np.roll(image, -SHIFT, 1), matches, 2), strict=True))


def test_brightness_that_differs_between_the_cameras_is_no_disagreement() -> None:
    """Vignetting darkens a surface differently in both images."""
    left = texture(2.0)
    right = np.roll(left, -SHIFT, axis=1)
    brighter = right + np.linspace(0.0, 8.0 * 16, WIDTH).astype(np.uint16)
    assert judged(left, brighter, SHIFT)[1] == pytest.approx(judged(left, right, SHIFT)[1], abs=0.01)


def test_texture_outside_the_window_counts() -> None:
    """A plain stripe between textures guides the matcher better than a plain wall."""
    striped = texture(20.0)
    striped[:, 40:56] = 128 * 16
    features = features_of(striped)
    assert features["min_texture"][32, 48] < 1.0
    assert features["wide_texture"][32, 48] > 10.0


def test_a_single_edge_is_a_step_and_no_even_texture() -> None:
    """Which side of an edge a match belongs to is unknown; beside a line, or in a texture, it is right."""
    edge, line = texture(0.0), texture(0.0)
    edge[:, 48:] += 40 * 16
    line[:, 48:50] += 40 * 16
    of_edge, of_line, of_texture = features_of(edge), features_of(line), features_of(texture(20.0))
    assert of_edge["step"][32, 48] > 0.9
    assert of_line["step"][32, 48] < 0.1
    assert of_texture["step"][32, 48] < 0.5
    assert of_edge["even_texture"][32, 48] < of_texture["even_texture"][32, 48]


def test_the_side_of_an_edge_is_seen() -> None:
    """Left of what is nearer, points are hidden from the right camera; right of it, both cameras see them."""
    matches = np.full((HEIGHT, WIDTH), SHIFT * 16, np.uint16)
    matches[:, 40:60] += 5 * 16
    image = texture(20.0)
    features = dict(zip(FEATURES, match_features(image, np.roll(image, -SHIFT, 1), matches, 2), strict=True))
    columns = [30, 36, 50, 63, 69]
    assert features["nearer_right"][32, columns].tolist() == [0.0, 5.0, 0.0, 0.0, 0.0]
    assert features["nearer_left"][32, columns].tolist() == [0.0, 0.0, 0.0, 5.0, 0.0]
    # Two pixels beside the wrong matches, the window has some of them, and the small one none.
    assert features["residual"][32, 38] > 0.5
    assert features["small_residual"][32, 38] < 0.1
    assert features["small_residual"][32, 42] > 0.5


@pytest.mark.parametrize("level", [20, 128, 230])
def test_noise_is_even_at_all_grey_levels(level: int) -> None:
    noise_sigma = np.linspace(0.2, 2.0, 256)
    noise = np.random.default_rng(5).normal(level, noise_sigma[level], (HEIGHT, WIDTH))
    even = with_even_noise(np.rint(noise * 16).astype(np.uint16), noise_sigma)
    assert even.std() / 16 == pytest.approx(min(noise_sigma[level], EVEN_NOISE), rel=0.1)


def test_matches_without_texture_around_them_are_no_matches() -> None:
    """On a plain wall, noise or the things beside it would have made them."""
    half = texture(20.0)
    half[:, :60] = 128 * 16
    matches = np.full(half.shape, SHIFT * 16, np.uint16)
    kept = with_texture(matches, match_features(half, np.roll(half, -SHIFT, 1), matches, 2))
    assert (kept[:, :36] == 0).all()
    assert (kept[:, 60:] == SHIFT * 16).all()


def test_pixels_without_a_match_have_neither() -> None:
    left = texture(20.0)
    matches = np.full(left.shape, SHIFT * 16, np.uint16)
    matches[10:20, 30:50] = 0
    error, confidence = error_and_confidence(match_features(left, left, matches, 2), matches, 2)
    assert (error[matches == 0] == 0).all()
    assert (confidence[matches == 0] == 0).all()
    assert (error[matches > 0] > 0).all()


def test_disparities_beyond_the_image_are_compared_with_its_edge() -> None:
    left = texture(20.0)
    matches = np.full(left.shape, 65535, np.uint16)
    assert np.isfinite(match_features(left, left, matches, 2)).all()


def test_tables_fit_the_features() -> None:
    content = tables()
    assert set(ERROR_BORDERS) < set(FEATURES)
    assert content.error.shape == tuple(len(borders) + 1 for borders in ERROR_BORDERS.values())
    assert content.error.min() >= 1
    assert content.features.shape == content.borders.shape == (len(content.weights), TREE_DEPTH)
    assert content.weights.shape[1] == 2**TREE_DEPTH
