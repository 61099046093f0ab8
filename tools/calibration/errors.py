"""Errors of matched depth on scenes that ``confidence`` is not fitted to: ``python -m tools.calibration.errors``.

Images of ``scenes`` and of the demo, without and with the projector, at quality High. ``real_pair`` is the same for a
real pair.
"""

import argparse
import itertools
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.imaging.matched_depth import matched_depth
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.filters import Filters
from renderers.stereo.model import DISPARITY_SCALE, Quality
from tools.calibration.samples import Sample, demo_samples, samples

SEEDS: Final = (1, 2, 3, 4, 5)
"""Seeds of the scenes; ``confidence`` has others. The table by scene uses the first one."""
NO_FILTERS: Final = Filters(minconf=0.0, seg=0, fill=0)
"""Filters that keep every measured pixel, and only these."""
BINS: Final = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.01)
"""Borders of the bins of confidence, in each of which it is compared with the share of right pixels."""


def match(sample: Sample) -> DepthImages:
    """Return the depth images of a sample."""
    return matched_depth(sample.imaging.config, sample.pair, sample.settings, None)


def unfiltered(sample: Sample) -> Sample:
    """Return the sample without post-processing: confidences are those of the measurement."""
    return replace(sample, settings=replace(sample.settings, filters=NO_FILTERS))


def deviation_of(sample: Sample, images: DepthImages) -> NDArray[np.float32]:
    """Return measured minus exact disparity, (H, W) float32, pixels; NaN where either is missing."""
    known = (images.disparity > 0) & (sample.exact > 0)
    return np.where(known, images.disparity * np.float32(DISPARITY_SCALE) - sample.exact, np.float32(np.nan))


def normals_of(sample: Sample, disparity: NDArray[np.floating], reach: int = 4) -> NDArray[np.float64]:
    """Return the unit normals of a disparity image, (H - 2 reach, W - 2 reach, 3) float64; NaN: unknown.

    Args:
        disparity: (H, W), pixels, 0: invalid.
        reach: half the distance of the pixels whose difference is taken, pixels.
    """
    model, divisor = sample.imaging.config.model, sample.settings.quality.divisor
    k = model.intrinsics(divisor)
    rows, columns = np.mgrid[0 : k.height, 0 : k.width] + 0.5
    scale = np.where(disparity > 0, model.baseline / np.where(disparity > 0, disparity, 1.0), np.nan)
    points = np.stack(((columns - k.cx) * scale, (rows - k.cy) * scale, k.focal_length * scale), axis=2)
    across = points[reach:-reach, 2 * reach :] - points[reach:-reach, : -2 * reach]
    down = points[2 * reach :, reach:-reach] - points[: -2 * reach, reach:-reach]
    normal: NDArray[np.float64] = np.cross(across, down)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return normal


def normal_error(sample: Sample, images: DepthImages) -> float:
    """Return the median angle between measured and exact normals, degrees."""
    measured, exact = normals_of(sample, images.disparity * DISPARITY_SCALE), normals_of(sample, sample.exact)
    return float(np.nanmedian(np.degrees(np.arccos(np.clip((measured * exact).sum(axis=2), -1.0, 1.0)))))


def reliability(pairs: list[tuple[Sample, DepthImages]]) -> list[tuple[float, float, int]]:
    """Return the rows of ``reliability_of`` for all pixels with exact disparity."""
    confidence, is_right = [], []
    for sample, images in pairs:
        deviation = deviation_of(sample, images)
        known = np.isfinite(deviation)
        confidence.append(images.confidence[known] / 255.0)
        is_right.append(np.abs(deviation[known]) <= 3.0 * images.error[known] * DISPARITY_SCALE + 1e-6)
    return reliability_of(np.concatenate(confidence), np.concatenate(is_right))


def reliability_of(confidence: NDArray[np.float64], is_right: NDArray[np.bool_]) -> list[tuple[float, float, int]]:
    """Return mean confidence, share of right pixels and number of pixels, for each of ``BINS``; arguments: (N,)."""
    rows = []
    for low, high in itertools.pairwise(BINS):
        inside = (confidence >= low) & (confidence < high)
        count = int(inside.sum())
        said, right = (float(values[inside].sum()) / max(count, 1) for values in (confidence, is_right))
        rows.append((said, right, count))
    return rows


def print_reliability(name: str, rows: list[tuple[float, float, int]]) -> None:
    """Print the share of right pixels minus the confidence in each of ``BINS``, and its mean."""
    total = max(sum(count for _, _, count in rows), 1)
    cells = (f"{right - said:+.3f} ({100.0 * count / total:4.1f})" for said, right, count in rows)
    mean = sum(count * abs(right - said) for said, right, count in rows) / total
    print(f"  {name:20}" + "".join(f"{cell:>15}" for cell in cells) + f"  {mean:.3f}")


def report_errors(group: list[Sample]) -> None:
    """Print the errors of each sample, and their medians."""
    print("\nscene, projector, valid, off by > 1 px, standard deviation of the others px, normals degrees")
    rows = []
    for sample in group:
        images = match(sample)
        deviation = deviation_of(sample, images)
        known = deviation[np.isfinite(deviation)]
        small = known[np.abs(known) < 1.0]
        wrong = float((np.abs(known) > 1.0).mean()) if known.size else 0.0
        spread = float(small.std()) if small.size else 0.0
        row = float((images.disparity > 0).mean()), wrong, spread, normal_error(sample, images)
        rows.append(row)
        print(f"  {sample.name:15} {'on' if sample.projector else 'off':3}", *(f"{value:7.3f}" for value in row))
    print("  median             ", *(f"{value:7.3f}" for value in np.median(rows, axis=0)))


def report_confidence(title: str, group: list[Sample]) -> None:
    """Print how far the share of right pixels is from the confidence, without and with the projector."""
    print(f"\n{title}: share right minus confidence, (% of the pixels), for confidence from {BINS[:-1]}; mean")
    for projector in (False, True):
        chosen = [(each, match(each)) for each in map(unfiltered, group) if each.projector == projector]
        print_reliability(f"projector {'on' if projector else 'off'}", reliability(chosen))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--realism", action="store_true", help="images with all parts of --stereo-realism")
    realism: bool = parser.parse_args().realism
    scenes = [list(samples(Quality.HIGH, seed, realism=realism)) for seed in SEEDS]
    demo = list(demo_samples(realism=realism))
    report_errors(scenes[0])
    report_errors(demo)
    report_confidence("scenes", [sample for group in scenes for sample in group])
    report_confidence("demo", demo)


if __name__ == "__main__":
    main()
