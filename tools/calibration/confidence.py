"""Fit ``renderers/stereo/depth/match_confidence.json``: ``python -m tools.calibration.confidence``.

Matches images of ``scenes`` and ``plain_scenes`` without and with realism, and compares the matches with the exact
disparity. Most of the matches are of textures like photographs: with noise and plain surfaces alone, the confidences
near edges of photographs are too low. ``errors`` and ``real_pair`` judge the result with images that the fit does not
see.
"""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.depth.match_confidence import (
    ERROR_BORDERS,
    FEATURES,
    FILE,
    TREE_DEPTH,
    WEIGHT_UNIT,
    match_features,
    with_even_noise,
    with_texture,
)
from renderers.stereo.depth.matching import find_matches
from renderers.stereo.model import Quality
from tools.calibration.plain_scenes import PLAIN_SCENES
from tools.calibration.samples import Sample, samples
from tools.calibration.scenes import LEAFY_SCENES, SCENES

SEEDS: Final = {Quality.MEDIUM: range(100, 103), Quality.HIGH: range(100, 108), Quality.FULL: range(100, 103)}
"""Seeds of the scenes. Of few, the trees learn in which of them a plain wall happened to be right."""
PIXELS: Final = {Quality.MEDIUM: 150, Quality.HIGH: 150, Quality.FULL: 300}
"""Maximum number of matches of an image that count."""
LEAFY_SEEDS: Final = {Quality.HIGH: range(100, 104), Quality.FULL: range(100, 104)}
"""Seeds of the scenes with textures like photographs."""
LEAFY_PIXELS: Final = dict.fromkeys(LEAFY_SEEDS, 1_000)
"""Maximum number of matches of an image of theirs that count."""
RIGHT_PER_WRONG: Final = 250
"""Number of matches of an image for each that counts at a wrong disparity. Those of the matcher never contradict both
images in strong texture, so the fit would not learn what that means."""
PRIOR: Final = 200.0
"""Weight of the mean error of all matches in a cell, pixels."""
ERROR_FACTOR: Final = 1.2
"""Factor of the errors: those of photographs are 1.1 to 1.4 times as large as those of the scenes, by pair."""
TREES: Final = 32
"""Number of trees."""
RATE: Final = 0.3
"""Share of its best step that a tree takes; the last tree takes all of it."""
RIDGE: Final = 20.0
"""Penalty of squared weights: those of rare leaves stay small."""
BORDERS: Final = 31
"""Number of borders of a feature from which a tree chooses: quantiles of the matches."""


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Some matches of a sample."""

    features: NDArray[np.float32]
    """(12, N) float32, ``FEATURES``."""
    deviations: NDArray[np.float32]
    """(N,) float32, absolute differences from the exact disparity, pixels."""


@dataclass(frozen=True, slots=True, eq=False)
class Tree:
    """A decision tree."""

    compare: list[tuple[int, float]]
    """Numbers of the features and borders that it compares."""
    weights: NDArray[np.int64]
    """(2 ** ``TREE_DEPTH``,) int64, units of ``WEIGHT_UNIT``."""

    def sums(self, features: NDArray[np.float32]) -> NDArray[np.int64]:
        """Return the weight of each match, (N,) int64."""
        leaf = np.zeros(features.shape[1], np.int64)
        for number, border in self.compare:
            leaf = leaf * 2 + (features[number] >= np.float32(border))
        return self.weights[leaf]


def collect(sample: Sample, matches: NDArray[np.uint16], pixels: int) -> Iterator[Matches]:
    """Yield matches of a sample that have texture and an exact disparity, and a few of many that are wrong on purpose.

    Args:
        sample: images and exact disparity.
        matches: (H, W) uint16, units of 1/16 pixel, 0: no match (``find_matches``).
        pixels: maximum number of matches that count.
    """
    random = np.random.default_rng(0)
    shifted = np.where(matches > 0, matches + np.uint16(16 * random.integers(4, 24)), np.uint16(0))
    left, right = (with_even_noise(image, sample.noise_sigma) for image in (sample.left, sample.right))
    for disparity, count in ((matches, pixels), (shifted, pixels // RIGHT_PER_WRONG)):
        features = match_features(left, right, disparity, sample.settings.quality.divisor)
        known = np.flatnonzero((with_texture(disparity, features) > 0) & (sample.exact > 0))
        picked = random.choice(known, min(len(known), count), replace=False)
        deviation = np.abs(disparity / np.float32(16.0) - sample.exact).reshape(-1)[picked]
        yield Matches(features.reshape(len(FEATURES), -1)[:, picked], deviation)


def matches_of(sample: Sample) -> NDArray[np.uint16]:
    """Return the matches of a sample, as ``find_matches``."""
    noise, divisor = sample.noise_sigma, sample.settings.quality.divisor
    return find_matches(sample.left, sample.right, sample.disparity_count, noise, divisor)


def error_bins(features: NDArray[np.float32]) -> tuple[NDArray[np.intp], ...]:
    """Return the bins of the three features that give the error, (N,) each."""
    return tuple(
        np.searchsorted(np.asarray(borders, np.float32), features[list(FEATURES).index(name)], side="right")
        for name, borders in ERROR_BORDERS.items()
    )


def fit_errors(features: NDArray[np.float32], deviations: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return ``ERROR_FACTOR`` times the standard deviation of errors below a pixel by three bins, (6, 6, 6) int64.

    Units are 1/16 pixel.
    """
    shape = tuple(len(borders) + 1 for borders in ERROR_BORDERS.values())
    small = deviations < 1.0
    cells = np.ravel_multi_index(error_bins(features), shape)[small]
    squares, size = deviations[small].astype(float) ** 2, int(np.prod(shape))
    count, total = np.bincount(cells, minlength=size), np.bincount(cells, squares, size)
    variance = (total + PRIOR * squares.mean()) / (count + PRIOR)
    errors: NDArray[np.int64] = np.maximum(np.rint(ERROR_FACTOR * np.sqrt(variance) * 16), 1).astype(np.int64)
    return errors.reshape(shape)


def fit_trees(features: NDArray[np.float32], is_right: NDArray[np.bool_]) -> list[Tree]:
    """Return the trees of a gradient boosting with Newton's steps, of which all leaves of a level compare alike.

    Args:
        features: (12, N) float32.
        is_right: (N,).
    """
    shares = np.linspace(0.0, 1.0, BORDERS + 2)[1:-1]
    borders = [np.unique([float(f"{each:.3g}") for each in np.quantile(values, shares)]) for values in features]
    bins = [np.searchsorted(each, values, side="right") for each, values in zip(borders, features, strict=True)]
    sums = np.zeros(len(is_right))
    trees = []
    for number in range(TREES):
        share = 1.0 / (1.0 + np.exp(-sums * WEIGHT_UNIT))
        slope, curvature = is_right - share, share * (1.0 - share)
        leaf, compare = np.zeros(len(is_right), np.int64), []
        for level in range(TREE_DEPTH):
            gains = [
                _gains(leaf, 1 << level, each, slope, curvature)[: len(own)]
                for each, own in zip(bins, borders, strict=True)
            ]
            feature = int(np.argmax([each.max() for each in gains]))
            border = float(borders[feature][gains[feature].argmax()])
            leaf = leaf * 2 + (features[feature] >= np.float32(border))
            compare.append((feature, border))
        leaves = 1 << TREE_DEPTH
        step = np.bincount(leaf, slope, leaves) / (np.bincount(leaf, curvature, leaves) + RIDGE)
        rate = 1.0 if number == TREES - 1 else RATE
        trees.append(Tree(compare, np.rint(rate * step / WEIGHT_UNIT).astype(np.int64)))
        sums += trees[-1].sums(features)
    return trees


def _gains(
    leaf: NDArray[np.int64],
    leaves: int,
    bins: NDArray[np.intp],
    slope: NDArray[np.float64],
    curvature: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return how much the likelihood gains if all leaves are divided at each of a feature's borders.

    ``leaf`` and ``bins`` are those of each match, (N,). ``slope`` and ``curvature`` are the first derivative and the
    negative second one of the likelihood by its sum of weights, (N,).
    """
    count = BORDERS + 1
    slopes, curvatures = (
        np.bincount(leaf * count + bins, values, leaves * count).reshape(leaves, count).cumsum(axis=1)
        for values in (slope, curvature)
    )
    below, above = slopes[:, :-1], slopes[:, -1:] - slopes[:, :-1]
    weight_below, weight_above = curvatures[:, :-1], curvatures[:, -1:] - curvatures[:, :-1]
    gains: NDArray[np.float64] = (below**2 / (weight_below + RIDGE) + above**2 / (weight_above + RIDGE)).sum(axis=0)
    return gains


def fit(matches: Sequence[Matches]) -> tuple[NDArray[np.int64], list[Tree]]:
    """Return the errors of ``fit_errors`` and the trees of ``fit_trees``."""
    features = np.concatenate([each.features for each in matches], axis=1)
    deviations = np.concatenate([each.deviations for each in matches])
    errors = fit_errors(features, deviations)
    is_right = deviations <= 3.0 / 16.0 * errors[error_bins(features)] + 1e-6
    return errors, fit_trees(features, is_right)


def text_of(errors: NDArray[np.int64], trees: Sequence[Tree]) -> str:
    """Return the text of ``match_confidence.json``."""
    names = list(FEATURES)
    lines = [
        json.dumps({"compare": [(names[number], border) for number, border in tree.compare],
                    "weights": tree.weights.tolist()})
        for tree in trees
    ]  # fmt: skip
    return f'{{\n"error": {json.dumps(errors.tolist())},\n"trees": [\n' + ",\n".join(lines) + "\n]\n}\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.parse_args()
    matches = [
        each
        for scenes, seeds_of, pixels_of in (
            ((*SCENES, *PLAIN_SCENES), SEEDS, PIXELS),
            (LEAFY_SCENES, LEAFY_SEEDS, LEAFY_PIXELS),
        )
        for realism in (False, True)
        for quality, seeds in seeds_of.items()
        for seed in seeds
        for sample in samples(quality, seed, realism=realism, scenes=scenes)
        for each in collect(sample, matches_of(sample), pixels_of[quality])
    ]
    FILE.write_text(text_of(*fit(matches)), encoding="utf-8")


if __name__ == "__main__":
    main()
