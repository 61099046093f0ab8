"""Fit ``renderers/stereo/depth/match_confidence.json``: ``python -m bench.sensor_confidence``.

Matches images of the scenes of ``sensor_scenes`` without and with realism, and compares the matches with the exact
disparity. ``bench.sensor`` judges the result with other seeds and with the demo, which the fit never sees.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.sensor_fit import all_samples
from bench.sensor_images import Sample
from renderers.stereo.depth.match_confidence import (
    BINS,
    BORDERS,
    ERROR_FEATURES,
    FEATURES,
    FILE,
    WEIGHT_UNIT,
    match_features,
)
from renderers.stereo.depth.pixel_classes import MIN_NOISE_SIGMA
from renderers.stereo.model import Quality

SEEDS: Final = range(100, 103)
"""Seeds of the scenes."""
PIXELS: Final = 20_000
"""Maximum number of matches of an image that count."""
PRIOR: Final = 200.0
"""Weight of the mean error of all matches in a cell, pixels."""
RIDGE: Final = 20.0
"""Penalty of squared weights: those of rare bins stay small."""
NEWTON_STEPS: Final = 12
"""Steps of the logistic regression. Six more change no weight."""


def collect(
    pairs: Iterable[tuple[Sample, NDArray[np.uint16]]],
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the features of matches, (6, N), and their deviations from the exact disparity, (N,) pixels."""
    random = np.random.default_rng(0)
    features, deviations = [], []
    for sample, matches in pairs:
        planes = match_features(sample.left, sample.right, matches, max(sample.noise_sigma, MIN_NOISE_SIGMA))
        known = np.flatnonzero((matches > 0) & (sample.exact > 0))
        picked = random.choice(known, min(len(known), PIXELS), replace=False)
        features.append(planes.reshape(len(FEATURES), -1)[:, picked])
        deviations.append((matches / np.float32(16.0) - sample.exact).reshape(-1)[picked])
    return np.concatenate(features, axis=1), np.concatenate(deviations).astype(np.float32)


def fit_errors(first: NDArray[np.intp], second: NDArray[np.intp], deviations: NDArray[np.float32]) -> NDArray[np.int_]:
    """Return the standard deviation of errors below a pixel by two bins, (``BINS``, ``BINS``), units of 1/16 pixel."""
    small = np.abs(deviations) < 1.0
    cells, squares = (first * BINS + second)[small], deviations[small].astype(float) ** 2
    count, total = np.bincount(cells, minlength=BINS**2), np.bincount(cells, squares, BINS**2)
    variance = (total + PRIOR * squares.mean()) / (count + PRIOR)
    errors: NDArray[np.int_] = np.maximum(np.rint(np.sqrt(variance) * 16), 1).astype(int).reshape(BINS, BINS)
    return errors


def fit_weights(bins: NDArray[np.intp], is_right: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the weights of a logistic regression by bin of each feature, (6, ``BINS``) float64.

    Args:
        bins: (6, N), bin of each feature.
        is_right: (N,).
    """
    parameters = len(bins) * BINS
    cells, place = np.unique(bins + np.arange(len(bins))[:, None] * BINS, axis=1, return_inverse=True)
    count, right = np.bincount(place.ravel()), np.bincount(place.ravel(), is_right)
    weights = np.zeros(parameters)
    for _ in range(NEWTON_STEPS):
        share = 1.0 / (1.0 + np.exp(-weights[cells].sum(axis=0)))
        slope = np.zeros(parameters)
        curvature = np.diag(np.full(parameters, RIDGE))
        for row in cells:
            slope += np.bincount(row, right - count * share, parameters)
            for other in cells:
                pairs = np.bincount(row * parameters + other, count * share * (1.0 - share), parameters**2)
                curvature += pairs.reshape(parameters, parameters)
        weights += np.linalg.solve(curvature, slope - RIDGE * weights)
    return weights.reshape(len(bins), BINS)


def fitted_text(features: NDArray[np.float32], deviations: NDArray[np.float32]) -> str:
    """Return the text of ``match_confidence.json`` for the results of ``collect``."""
    bins = np.stack(
        [np.searchsorted(BORDERS[name], each, side="right") for name, each in zip(FEATURES, features, strict=True)]
    )
    first, second = (bins[list(FEATURES).index(name)] for name in ERROR_FEATURES)
    errors = fit_errors(first, second, deviations)
    is_right = np.abs(deviations) <= 3.0 / 16.0 * errors[first, second] + 1e-6
    weights = np.rint(fit_weights(bins, is_right) / WEIGHT_UNIT).astype(int)
    columns = {"error": errors, **dict(zip(FEATURES, weights, strict=True))}
    return "{\n" + ",\n".join(f'"{name}": {json.dumps(values.tolist())}' for name, values in columns.items()) + "\n}\n"


def main() -> None:
    argparse.ArgumentParser(description=__doc__.partition("\n")[0]).parse_args()
    kinds = (all_samples((Quality.HIGH, Quality.MEDIUM), SEEDS, realism=realism) for realism in (False, True))
    FILE.write_text(fitted_text(*collect(pair for kind in kinds for pair in kind)), encoding="utf-8")


if __name__ == "__main__":
    main()
