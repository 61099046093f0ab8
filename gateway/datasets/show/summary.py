"""Statistics of a dataset's objects, and the samples with each class."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Final

import numpy as np

from scenegate.datasets import Dataset

MAX_SAMPLES: Final = 50_000
"""Maximum number of samples that are read. They take about two seconds."""
BINS: Final = 20
"""Number of bins of a histogram."""


@dataclass(frozen=True, slots=True)
class Histogram:
    """Number of objects in each of ``BINS`` equal intervals from ``low`` to ``high``."""

    title: str
    low: float
    high: float
    unit: str
    """Unit of ``low`` and ``high``."""
    counts: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Summary:
    """Statistics of the samples that were read."""

    sample_indices: tuple[int, ...]
    """Indices in the dataset."""
    samples_by_class: dict[int, tuple[int, ...]]
    """Indices of the samples with visible objects of each class."""
    objects_by_class: dict[int, int]
    """Number of objects of each class, in all samples."""
    histograms: tuple[Histogram, ...]
    """Distance and visibility of the objects; empty if there are none."""


def random_samples(dataset: Dataset, count: int) -> tuple[int, ...]:
    """Return the sorted indices of up to ``count`` random samples, the same ones for each call.

    Evenly spaced samples could all be of one camera.
    """
    chosen = np.random.default_rng(0).choice(len(dataset), min(count, len(dataset)), replace=False)
    return tuple(np.sort(chosen).tolist())


def summarize(dataset: Dataset) -> Summary:
    """Read the records of a dataset.

    Raises:
        RecordError: a line of the manifest cannot be read.
    """
    indices = random_samples(dataset, MAX_SAMPLES)
    samples_by_class: dict[int, list[int]] = {}
    objects: Counter[int] = Counter()
    distances: list[float] = []
    visibilities: list[float] = []
    for index in indices:
        records = dataset[index].objects
        objects.update(record.class_id for record in records)
        for class_id in {record.class_id for record in records if record.visible_pixels}:
            samples_by_class.setdefault(class_id, []).append(index)
        distances += (float(np.linalg.norm(np.array(record.X_camera_object)[:3, 3])) for record in records)
        visibilities += (record.visible_fraction for record in records)
    histograms: tuple[Histogram, ...] = ()
    if distances:
        histograms = (
            _histogram("Distance from the camera", distances, (min(distances), max(distances)), "m"),
            _histogram("Visible fraction", [100.0 * value for value in visibilities], (0.0, 100.0), "%"),
        )
    by_class = {class_id: tuple(found) for class_id, found in samples_by_class.items()}
    return Summary(indices, by_class, dict(objects), histograms)


def _histogram(title: str, values: list[float], limits: tuple[float, float], unit: str) -> Histogram:
    counts, edges = np.histogram(values, BINS, limits)
    return Histogram(title, float(edges[0]), float(edges[-1]), unit, tuple(counts.tolist()))
