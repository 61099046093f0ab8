"""Fit ``renderers/stereo/depth/matcher_statistics.json``, our matcher's statistics: ``python -m bench.sensor_fit``.

Matches images of the scenes of ``sensor_scenes``, and compares the matches with the exact disparity in each class
of pixels (``pixel_classes``).
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.sensor_images import Sample, samples
from bench.sensor_scenes import SCENES, Scene
from renderers.stereo.depth.image_pair import grey_levels
from renderers.stereo.depth.matching import find_matches
from renderers.stereo.depth.pixel_classes import (
    CLASSES,
    DISAGREEMENTS,
    EDGES,
    MIN_NOISE_SIGMA,
    STATISTICS_FILE,
    TEXTURES,
    ImageKind,
    classify,
    window_range,
)
from renderers.stereo.model import Quality

SEEDS: Final = range(100, 106)
"""Seeds of the scenes."""
PRIOR: Final = 200.0
"""Weight of the mean of the classes of equal texture and edge, pixels. Rare classes get about that mean."""
TEXTURELESS: Final = 3
"""Number of the lowest classes of texture, which hardly exceed the noise."""


def _zeros() -> NDArray[np.float64]:
    """Return a sum of 0 for each class."""
    return np.zeros(CLASSES)


@dataclass
class Totals:
    """Sums over all pixels by class, (``CLASSES``,) float64 each. A match is right within 3 disparity errors."""

    matched_small: NDArray[np.float64] = field(default_factory=_zeros)
    """Number of matches that are off by less than a pixel, by the class at their match."""
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

    left, right = grey_levels(sample.left), grey_levels(sample.right)
    at_match = classify(left, right, matches, *window_range(matches), noise)
    known = has_match & has_truth
    classes, off = at_match[known], np.abs(deviation[known])
    totals.matched_small += count(classes[off < 1.0])
    totals.matched_square += count(classes[off < 1.0], off[off < 1.0] ** 2)

    sixteenths = np.floor(sample.visible * 16.0 + 0.5).astype(np.uint16)
    nearest, farthest = window_range(sixteenths)
    at_truth = classify(left, right, sixteenths, nearest, farthest, noise)
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


Table = dict[str, NDArray[np.float64]]
"""``pixel_classes.STATISTICS``, (``CLASSES`` + 1,) each."""


def table(totals: Totals) -> Table:
    """Return the table for the totals of all samples."""
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
    by_class = {
        "found": (shares(totals.found, totals.visible), totals.hidden_found / totals.hidden),
        "right": (right, 0.0),
        "confidence": (confidence.reshape(-1), 0.0),
        "neighbour_confidence": (neighbour.reshape(-1), front_right.sum() / front_found.sum()),
        "relative_error": (np.maximum(spread / best_spread, 1.0), 1.0),
    }
    return {name: np.append(values, hidden) for name, (values, hidden) in by_class.items()}


def fitted_table(pairs: list[tuple[Sample, NDArray[np.uint16]]]) -> tuple[Table, Totals]:
    """Return the table for samples with their matches, and the totals from which it follows."""
    error = np.full(CLASSES, 0.2)
    for _ in range(2):  # the first pass measures the errors that limit right matches in the second one
        totals = Totals()
        for sample, matches in pairs:
            add_sample(totals, sample, matches, error)
        error = np.maximum(np.rint(np.sqrt(shares(totals.matched_square, totals.matched_small)) * 16), 1) / 16
    return table(totals), totals


def all_samples(
    qualities: tuple[Quality, ...], seeds: range, *, realism: bool, scenes: Sequence[Scene] = SCENES
) -> Iterator[tuple[Sample, NDArray[np.uint16]]]:
    """Yield all samples with their matches, (H, W) uint16 each."""
    for quality in qualities:
        for seed in seeds:
            for sample in samples(quality, seed, realism=realism, scenes=scenes):
                yield sample, find_matches(sample.left, sample.right, sample.disparity_count, sample.noise_sigma)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="number of seeds; default: all")
    options = parser.parse_args()
    by_kind: dict[str, Table] = {}
    excess = wrong = 0.0
    for realism in (False, True):
        pairs = list(all_samples((Quality.HIGH, Quality.MEDIUM), SEEDS[: options.seeds], realism=realism))
        for dots in (False, True):
            kind = ImageKind.of(dots=dots, realistic=realism)
            by_kind[kind.name], totals = fitted_table([pair for pair in pairs if pair[0].projector == dots])
            excess, wrong = excess + totals.wrong_excess, wrong + totals.wrong
    # The mean of the absolute value of a normal variable is 0.798 of its standard deviation.
    STATISTICS_FILE.write_text(text_of(by_kind, excess / wrong * 16 / 0.798), encoding="utf-8")


def text_of(by_kind: dict[str, Table], wrong_spread: float) -> str:
    """Return the text of ``matcher_statistics.json``, one line for each column of a table."""
    lines = [f'"wrong_spread": {wrong_spread:.1f}']
    for kind, columns in by_kind.items():
        rows = (f' "{name}": {json.dumps([round(float(v), 4) for v in values])}' for name, values in columns.items())
        lines.append(f'"{kind}": {{\n' + ",\n".join(rows) + "\n}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


if __name__ == "__main__":
    main()
