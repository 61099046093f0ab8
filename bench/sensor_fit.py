"""Fit the statistics of our matcher: ``python -m bench.sensor_fit`` writes ``renderers/stereo/matcher_statistics.py``.

Matches images of the ten scenes of ``sensor_scenes``, and compares the matches with the exact disparity in each class
of pixels (``pixel_classes``).
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.sensor_images import Sample, samples
from bench.sensor_source import Tables, source
from renderers.stereo.matching import MIN_NOISE_SIGMA, find_matches
from renderers.stereo.model import Quality
from renderers.stereo.pixel_classes import CLASSES, DISAGREEMENTS, EDGES, TEXTURES, ImageKind, classify, window_range

TARGET: Final = Path(__file__).parents[1] / "renderers/stereo/matcher_statistics.py"
SEEDS: Final = range(100, 108)
"""Seeds of the scenes."""
PRIOR: Final = 200.0
"""Weight of the mean of the classes of equal texture and edge, pixels. Rare classes get about that mean."""
TEXTURELESS: Final = 3
"""Number of the lowest classes of texture, which hardly exceed the noise."""
LAGS: Final = 40
"""Number of distances for which the autocorrelation of errors is measured: 0 to 39 pixels."""


def _zeros() -> NDArray[np.float64]:
    """Return a sum of 0 for each class."""
    return np.zeros(CLASSES)


@dataclass
class Totals:
    """Sums over all pixels by class, (``CLASSES``,) float64 each. A match is right within 3 disparity errors."""

    matched: NDArray[np.float64] = field(default_factory=_zeros)
    """Number of pixels with a match, by the class at their match; so are all of ``matched_*``."""
    matched_right: NDArray[np.float64] = field(default_factory=_zeros)
    """Number of right matches."""
    matched_small: NDArray[np.float64] = field(default_factory=_zeros)
    """Number of matches that are off by less than a pixel."""
    matched_square: NDArray[np.float64] = field(default_factory=_zeros)
    """Sum of the squared errors of ``matched_small``, pixels squared."""
    visible: NDArray[np.float64] = field(default_factory=_zeros)
    """Number of pixels that both cameras see, by the class at their exact disparity; so are the next four fields."""
    found: NDArray[np.float64] = field(default_factory=_zeros)
    """Number of visible pixels with a match."""
    right: NDArray[np.float64] = field(default_factory=_zeros)
    """Number of visible pixels with a right match."""
    small: NDArray[np.float64] = field(default_factory=_zeros)
    """Number of visible pixels with a match that is off by less than a pixel."""
    square: NDArray[np.float64] = field(default_factory=_zeros)
    """Sum of the squared errors of ``small``, pixels squared."""
    hidden: float = 0.0
    """Number of pixels of all classes that cannot be measured, beside a nearer surface."""
    hidden_found: float = 0.0
    """Number of hidden pixels with the disparity of that surface."""
    hidden_right: float = 0.0
    """Number of hidden pixels with the disparity of that surface, which is right: the surface is their own."""
    wrong_excess: float = 0.0
    """Sum of the errors beyond 3 disparity errors, of wrong pixels without an edge, pixels."""
    wrong: float = 0.0
    """Number of wrong pixels without an edge."""


def add_sample(totals: Totals, sample: Sample, matches: NDArray[np.uint16], error: NDArray[np.float64]) -> None:
    """Add a sample to the totals.

    Args:
        totals: sums to add to.
        sample: images and exact disparity.
        matches: (H, W) uint16, units of 1/16 pixel, 0: no match (``find_matches``).
        error: (``CLASSES``,) float64, disparity error of a match by its class, pixels.
    """
    noise = max(sample.noise_sigma, MIN_NOISE_SIGMA)
    deviation = matches / 16.0 - sample.exact
    has_match, has_truth = matches > 0, sample.exact > 0

    def count(classes: NDArray[np.uint8], weights: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        return np.bincount(classes, weights, minlength=CLASSES).astype(np.float64)

    at_match = classify(sample.left, sample.right, matches, *window_range(matches), noise)
    known = has_match & has_truth
    classes, off = at_match[known], np.abs(deviation[known])
    totals.matched += count(classes)
    totals.matched_right += count(classes[off <= 3.0 * error[classes]])
    totals.matched_small += count(classes[off < 1.0])
    totals.matched_square += count(classes[off < 1.0], off[off < 1.0] ** 2)

    sixteenths = np.floor(sample.visible * 16.0 + 0.5).astype(np.uint16)
    nearest, farthest = window_range(sixteenths)
    at_truth = classify(sample.left, sample.right, sixteenths, nearest, farthest, noise)
    visible = sixteenths > 0
    totals.visible += count(at_truth[visible])
    both = visible & has_match
    classes, off = at_truth[both], np.abs(deviation[both])
    is_right = off <= 3.0 * error[classes]
    totals.found += count(classes)
    totals.right += count(classes[is_right])
    totals.small += count(classes[off < 1.0])
    totals.square += count(classes[off < 1.0], off[off < 1.0] ** 2)
    has_nearest = np.abs(matches.astype(np.int32) - nearest) < 16
    column = np.arange(sixteenths.shape[1]) * 16
    hidden = ~visible & (nearest > 0) & (column >= nearest)
    totals.hidden += float(hidden.sum())
    hidden_found = hidden & has_match & has_nearest
    totals.hidden_found += float(hidden_found.sum())
    totals.hidden_right += float((hidden_found & (np.abs(deviation) <= 3.0 * error[at_truth])).sum())
    wrong = ~is_right & (classes % EDGES == 0)
    totals.wrong_excess += float(np.minimum(off[wrong] - 3.0 * error[classes[wrong]], 20.0).sum())
    totals.wrong += float(wrong.sum())


def autocovariance(sample: Sample, matches: NDArray[np.uint16]) -> NDArray[np.float64]:
    """Return sums for the autocorrelation of the errors below a pixel along rows, (``LAGS``, 2) float64.

    A row has the sum of the products of two errors at that distance, and the number of products.
    """
    deviation = matches / 16.0 - sample.visible
    small = (matches > 0) & (sample.visible > 0) & (np.abs(deviation) < 1.0)
    values = np.where(small, deviation, 0.0)
    sums = []
    for lag in range(LAGS):
        left, right = slice(None, values.shape[1] - lag), slice(lag, None)
        sums.append(((values[:, left] * values[:, right]).sum(), (small[:, left] & small[:, right]).sum()))
    return np.array(sums, np.float64)


def box_correlation(box: int) -> NDArray[np.float64]:
    """Return the autocorrelation of ``smooth_noise`` at the distances 0, 1, …, (``LAGS``,) float64."""
    weights = np.convolve(np.ones(box), np.ones(box))
    correlation = np.correlate(weights, weights, "full")[len(weights) - 1 :]
    padded = np.zeros(LAGS)
    padded[: min(LAGS, len(correlation))] = correlation[:LAGS] / correlation[0]
    return padded


def fit_boxes(correlation: NDArray[np.float64]) -> tuple[int, int, float]:
    """Return the boxes of near and wide noise, pixels, and the share of wide noise in the variance, by least squares.

    Args:
        correlation: (``LAGS``,) float64, autocorrelation of the errors.
    """
    best = (np.inf, 0, 0, 0.0)
    for near in range(2, 9):
        for wide in range(near + 1, 33):
            a, b = box_correlation(near), box_correlation(wide)
            share = float(np.clip(np.dot(correlation - a, b - a) / np.dot(b - a, b - a), 0.0, 1.0))
            residual = float(np.square(correlation - (1 - share) * a - share * b).sum())
            best = min(best, (residual, near, wide, share))
    return best[1:]


def shares(part: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``part / whole`` by class, (``CLASSES``,) float64, shrunk towards the mean of equal texture and edge.

    Classes without texture get that mean: there, the agreement of the windows depends on the scene alone.
    """
    shape = (TEXTURES, DISAGREEMENTS, EDGES)
    parts, wholes = part.reshape(shape), whole.reshape(shape)
    mean = parts.sum(axis=1, keepdims=True) / np.maximum(wholes.sum(axis=1, keepdims=True), 1.0)
    weight = np.full((TEXTURES, 1, 1), PRIOR)
    weight[:TEXTURELESS] = 1e12  # nothing but the mean
    values: NDArray[np.float64] = (parts + weight * mean) / (wholes + weight)
    return values.reshape(-1)


def tables(totals: Totals, error: NDArray[np.float64]) -> Tables:
    """Return the tables for the totals of all samples.

    Args:
        totals: totals of all samples.
        error: (``CLASSES``,) float64, disparity error with which the totals were counted, pixels.
    """
    right = shares(totals.right, totals.found)
    by_edge = (TEXTURES, DISAGREEMENTS, EDGES)
    is_right, is_wrong = (
        totals.right.reshape(by_edge).sum(axis=1),
        (totals.found - totals.right).reshape(by_edge).sum(axis=1),
    )
    # Pixels with the disparity of the front side of an edge: right ones in front, wrong ones behind, and hidden ones.
    # Hidden ones have no class. They are distributed over the textures as the right ones are.
    texture_share = is_right[:, 1] / is_right[:, 1].sum()
    front_right = is_right[:, 1] + texture_share * totals.hidden_right
    front_found = is_right[:, 1] + is_wrong[:, 2] + texture_share * totals.hidden_found
    front = (front_right + 1.0) / (front_found + 2.0)
    back = (is_right[:, 2] + 1.0) / (is_right[:, 2] + is_wrong[:, 1] + 2.0)
    confidence, neighbour = right.reshape(by_edge).copy(), right.reshape(by_edge).copy()
    confidence[:, :, 1], neighbour[:, :, 2] = front[:, None], front[:, None]
    confidence[:, :, 2], neighbour[:, :, 1] = back[:, None], back[:, None]
    spread = np.sqrt(shares(totals.square, totals.small))
    good_texture = np.s_[CLASSES // TEXTURES * (TEXTURES - 2) :]  # the two highest classes of texture
    best_spread = np.sqrt(totals.square[good_texture].sum() / totals.small[good_texture].sum())
    return Tables(
        shares(totals.found, totals.visible),
        right,
        confidence.reshape(-1),
        neighbour.reshape(-1),
        np.maximum(spread / best_spread, 1.0),
        error,
        shares(totals.matched_right, totals.matched),
        totals.hidden_found / totals.hidden,
        float(front_right.sum() / front_found.sum()),
    )


def fitted_tables(pairs: list[tuple[Sample, NDArray[np.uint16]]]) -> tuple[Tables, Totals]:
    """Return the tables for samples with their matches, and the totals from which the tables follow."""
    error = np.full(CLASSES, 0.2)
    for _ in range(2):  # the first pass measures the errors that limit right matches in the second one
        totals = Totals()
        for sample, matches in pairs:
            add_sample(totals, sample, matches, error)
        new_error = np.maximum(np.rint(np.sqrt(shares(totals.matched_square, totals.matched_small)) * 16), 1) / 16
        used, error = error, new_error
    return tables(totals, used), totals


def all_samples(
    qualities: tuple[Quality, ...], seeds: range, *, realism: bool
) -> Iterator[tuple[Sample, NDArray[np.uint16]]]:
    """Yield all samples with their matches, (H, W) uint16 each."""
    for quality in qualities:
        for seed in seeds:
            for sample in samples(quality, seed, realism=realism):
                yield sample, find_matches(sample.left, sample.right, sample.disparity_count)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="number of seeds; default: all")
    options = parser.parse_args()
    by_kind: dict[ImageKind, Tables] = {}
    sums = np.zeros((LAGS, 2))
    excess = wrong = 0.0
    for realism in (False, True):
        pairs = list(all_samples((Quality.HIGH, Quality.MEDIUM), SEEDS[: options.seeds], realism=realism))
        sums += np.sum([autocovariance(sample, matches) for sample, matches in pairs], axis=0)
        for dots in (False, True):
            kind = ImageKind.of(dots=dots, realistic=realism)
            by_kind[kind], totals = fitted_tables([pair for pair in pairs if pair[0].projector == dots])
            excess, wrong = excess + totals.wrong_excess, wrong + totals.wrong
    correlation = sums[:, 0] / sums[:, 1]
    # The mean of the absolute value of a normal variable is 0.798 of its standard deviation.
    spread = excess / wrong * 16 / 0.798
    text = source([by_kind[kind] for kind in ImageKind], spread, fit_boxes(correlation / correlation[0]))
    TARGET.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
