"""Errors of the stereo camera's depth in each mode: ``python -m bench.sensor [--over-time] [--light] [--realism]``.

Measured on the scenes of ``sensor_scenes`` and on the demo, without and with the projector, at High quality unless
a table says otherwise.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from bench import sensor_timing
from bench.sensor_fiducials import report_tags
from bench.sensor_images import Sample, demo_samples, renderer, samples
from bench.sensor_materials import report_materials, report_reach, report_response
from bench.sensor_plot import write_plot
from bench.sensor_time import report_over_time
from gateway.adapters.stereo.imaging.matched_depth import matched_depth
from gateway.adapters.stereo.imaging.rendered_images import rendered_depth
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.depth.filters import Filters
from renderers.stereo.depth.image_pair import grey_levels
from renderers.stereo.model import DISPARITY_SCALE, Quality

SEEDS: Final = (1, 2, 3, 4, 5)
"""Seeds of the scenes. The tables by scene use the first one, the tables by confidence use all. ``sensor_fit``
has others, and therefore other textures and places."""
NO_FILTERS: Final = Filters(minconf=0.0, seg=0, fill=0)
"""Filters that keep every measured pixel, and only these."""
FORMATS: Final = ("5.2f", "6.3f", "6.2f", "6.3f", "6.3f", "7.2f", "6.2f")
"""Formats of the columns of ``report_scenes``."""
BINS: Final = (0.0, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.01)
"""Borders of the bins of confidence, in each of which it is compared with the share of right pixels."""
MODES: Final[dict[str, Callable[[Sample], DepthImages]]] = {
    "modelled": lambda s: rendered_depth(s.imaging.config, *s.depth, s.pair, s.settings),
    "matched": lambda s: matched_depth(s.imaging.config, s.pair, s.settings, None),
    "ground_truth": lambda s: rendered_depth(s.imaging.config, *s.depth, None, s.settings),
}
"""Function that makes the depth images of a sample, by mode."""


def deviation_of(sample: Sample, images: DepthImages) -> NDArray[np.float32]:
    """Return measured minus exact disparity, (H, W) float32, pixels; NaN where either is missing."""
    known = (images.disparity > 0) & (sample.exact > 0)
    return np.where(known, images.disparity * np.float32(DISPARITY_SCALE) - sample.exact, np.float32(np.nan))


def correlation(deviation: NDArray[np.float32], lag: int = 1) -> float:
    """Return the correlation of the errors of two pixels ``lag`` columns apart, from errors below a pixel."""
    small = np.where(np.abs(deviation) < 1.0, deviation, np.nan)
    left, right = small[:, :-lag].reshape(-1), small[:, lag:].reshape(-1)
    both = np.isfinite(left) & np.isfinite(right)
    return float(np.corrcoef(left[both], right[both])[0, 1]) if both.sum() > 100 and left[both].std() > 0 else 0.0


def high_frequency(deviation: NDArray[np.float32]) -> float:
    """Return the standard deviation of errors below a pixel from their mean over 3 x 3 pixels, pixels."""
    small = np.abs(deviation) < 1.0
    mean = cv2.blur(np.where(small, deviation, np.float32(0.0)), (3, 3))
    is_complete = cv2.erode(small.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return float((deviation - mean)[is_complete].std()) if is_complete.any() else float("nan")


def second_difference(sample: Sample, images: DepthImages) -> float:
    """Return the median of |z(x-1) - 2 z(x) + z(x+1)| along rows of the depth image, millimetres."""
    factor = sample.imaging.config.model.focal_times_baseline(sample.settings.quality.divisor)
    with np.errstate(divide="ignore"):
        z = np.where(images.disparity > 0, factor / (images.disparity * DISPARITY_SCALE), np.nan)
    return float(np.nanmedian(np.abs(z[:, :-2] - 2 * z[:, 1:-1] + z[:, 2:]))) * 1e3


def points_of(sample: Sample, disparity: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the points of a disparity image in the left optical frame, (H, W, 3) float64, metres; NaN: no point.

    Args:
        sample: sample with the camera's model.
        disparity: (H, W), pixels, 0: invalid.
    """
    model, divisor = sample.imaging.config.model, sample.settings.quality.divisor
    k = model.intrinsics(divisor)
    rows, columns = np.mgrid[0 : k.height, 0 : k.width] + 0.5
    scale = np.where(disparity > 0, model.baseline / np.where(disparity > 0, disparity, 1.0), np.nan)
    return np.stack(((columns - k.cx) * scale, (rows - k.cy) * scale, k.focal_length * scale), axis=2)


def normals_of(points: NDArray[np.float64], reach: int = 4) -> NDArray[np.float64]:
    """Return the unit normals of an image of points, (H - 2 reach, W - 2 reach, 3) float64.

    Args:
        points: (H, W, 3) float64.
        reach: half the distance of the pixels whose difference is taken, pixels.
    """
    across = points[reach:-reach, 2 * reach :] - points[reach:-reach, : -2 * reach]
    down = points[2 * reach :, reach:-reach] - points[: -2 * reach, reach:-reach]
    normal: NDArray[np.float64] = np.cross(across, down)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    return normal


def normal_error(sample: Sample, images: DepthImages) -> float:
    """Return the median angle between measured and exact normals, degrees."""
    measured = normals_of(points_of(sample, images.disparity * DISPARITY_SCALE))
    exact = normals_of(points_of(sample, sample.exact))
    angle = np.degrees(np.arccos(np.clip((measured * exact).sum(axis=2), -1.0, 1.0)))
    return float(np.nanmedian(angle))


def reliability(pairs: list[tuple[Sample, DepthImages]]) -> list[tuple[float, float, int]]:
    """Return the rows of ``reliability_of`` for all pixels with exact disparity."""
    confidence, is_right = [], []
    for sample, images in pairs:
        deviation = deviation_of(sample, images)
        known = np.isfinite(deviation)
        confidence.append(images.confidence[known] / 255.0)
        is_right.append(np.abs(deviation[known]) <= 3.0 * images.error[known] * images.error_scale + 1e-6)
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
    print(f"  {name:15}" + "".join(f"{cell:>13}" for cell in cells) + f"  {mean:.3f}")


def report_scenes(mode: str, pairs: list[tuple[Sample, DepthImages]]) -> None:
    """Print the errors of each sample, and their medians."""
    print(f"\n{mode}: scene, projector, valid, off by > 1 px, correlation of neighbours, high-frequency part px,")
    print("  standard deviation px, second difference mm, normals degrees")
    rows = []
    for sample, images in pairs:
        deviation = deviation_of(sample, images)
        known = deviation[np.isfinite(deviation)]
        small = known[np.abs(known) < 1.0]
        row = (
            float((images.disparity > 0).mean()),
            float((np.abs(known) > 1.0).mean()) if known.size else 0.0,
            correlation(deviation),
            high_frequency(deviation),
            float(small.std()) if small.size else 0.0,
            second_difference(sample, images),
            normal_error(sample, images),
        )
        rows.append(row)
        print_row(sample.name, "on" if sample.projector else "off", row)
    print_row("median", "", np.median(rows, axis=0))


def print_row(name: str, projector: str, row: Iterable[float]) -> None:
    numbers = " ".join(f"{value:{width}}" for value, width in zip(row, FORMATS, strict=True))
    print(f"  {name:15} {projector:3} {numbers}")


def report_confidence(mode: str, pairs: list[tuple[Sample, DepthImages]]) -> None:
    """Print how far the share of right pixels is from the confidence, without and with the projector, by scene."""
    for projector in (False, True):
        chosen = [pair for pair in pairs if pair[0].projector == projector]
        names = list(dict.fromkeys(sample.name for sample, _ in chosen))
        print(
            f"\n{mode}, projector {'on' if projector else 'off'}: share right minus confidence, (% of the pixels), for"
        )
        print(f"  {'confidence from':15}" + "".join(f"{low:13.2f}" for low in BINS[:-1]) + "   mean")
        for name in ("all", *names) if len(names) > 1 else names:
            print_reliability(name, reliability([pair for pair in chosen if name in ("all", pair[0].name)]))


def unfiltered(sample: Sample) -> Sample:
    """Return the sample without post-processing: confidences are those of the measurement."""
    return replace(sample, settings=replace(sample.settings, filters=NO_FILTERS))


def report_density() -> None:
    """Print the share of valid pixels of matched depth by quality."""
    print("\nmatched, share of valid pixels of all, projector on: Low, Medium, High")
    by_quality = [
        [(MODES["matched"](s).disparity > 0).mean() for s in samples(quality, SEEDS[0]) if s.projector]
        for quality in (Quality.LOW, Quality.MEDIUM, Quality.HIGH)
    ]
    print("  " + " ".join(f"{np.mean(values):.2f}" for values in by_quality))


def comparison_image(sample: Sample, images: DepthImages) -> NDArray[np.uint8]:
    """Return left image, disparity, and error from -1 to 1 pixel side by side, (H, 3 W, 3) uint8 BGR."""
    disparity = np.clip(images.disparity / 16.0 * 2.0, 0, 255).astype(np.uint8)
    coloured = cv2.applyColorMap(disparity, cv2.COLORMAP_TURBO)
    coloured[images.disparity == 0] = 0
    deviation = deviation_of(sample, images)
    error = cv2.applyColorMap(
        np.clip(np.nan_to_num(deviation) * 127.0 + 128.0, 0, 255).astype(np.uint8), cv2.COLORMAP_TWILIGHT_SHIFTED
    )
    error[~np.isfinite(deviation)] = 0
    return np.hstack((cv2.cvtColor(grey_levels(sample.left), cv2.COLOR_GRAY2BGR), coloured, error)).astype(np.uint8)


def write_sheet(folder: Path) -> None:
    """Write ``depth-modes.webp``, some of the folder's pictures side by side at 0.42 of their size."""
    rows = []
    for name in ("mixed_room-off", "poles-off", "shiny-on", "far-off"):
        modelled, matched = (cv2.imread(str(folder / f"{name}-{mode}.png")) for mode in ("modelled", "matched"))
        assert modelled is not None
        assert matched is not None
        rows.append(np.hstack((modelled, matched[:, matched.shape[1] // 3 :])))
    sheet = cv2.resize(np.vstack(rows), None, fx=0.42, fy=0.42, interpolation=cv2.INTER_AREA)
    cv2.imwrite(str(folder / "depth-modes.webp"), sheet, [cv2.IMWRITE_WEBP_QUALITY, 80])


def report_light(modes: dict[str, Callable[[Sample], DepthImages]], *, realism: bool) -> None:
    """Print how light reaches the images: materials, the projector's reach, response, and tags."""
    report_materials(modes, realism=realism)
    report_reach(modes, realism=realism)
    report_response()
    report_tags(renderer())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--realism", action="store_true", help="images with all parts of --stereo-realism")
    parser.add_argument("--pictures", type=Path, help="folder for images: left image, disparity and error side by side")
    parser.add_argument("--over-time", action="store_true", help="only the errors of static and moving scenes")
    parser.add_argument("--light", action="store_true", help="only materials, the projector's reach, response and tags")
    options = parser.parse_args()
    modes = {mode: MODES[mode] for mode in ("modelled", "matched")}
    if options.light:
        report_light(modes, realism=options.realism)
        return
    if options.over_time:
        if options.pictures:
            write_plot(options.pictures / "depth-over-time.webp", modes)
        report_over_time(modes, realism=options.realism)
        return
    first_samples = list(samples(Quality.HIGH, SEEDS[0], realism=options.realism))
    for mode, measure in MODES.items():
        pairs = [(sample, measure(sample)) for sample in first_samples]
        report_scenes(mode, pairs)
        if options.pictures:
            options.pictures.mkdir(parents=True, exist_ok=True)
            for sample, images in pairs:
                name = f"{sample.name}-{'on' if sample.projector else 'off'}-{mode}.png"
                cv2.imwrite(str(options.pictures / name), comparison_image(sample, images))
    if options.pictures:
        write_sheet(options.pictures)
    demo = list(demo_samples(realism=options.realism))
    for mode, measure in MODES.items():
        report_scenes(mode, [(sample, measure(sample)) for sample in demo])
    ten_scenes = [sample for seed in SEEDS for sample in samples(Quality.HIGH, seed, realism=options.realism)]
    for title, group in (("ten scenes", ten_scenes), ("demo", demo)):
        for mode in ("modelled", "matched"):
            report_confidence(f"{title}, {mode}", [(unfiltered(s), MODES[mode](unfiltered(s))) for s in group])
    report_density()
    report_light(modes, realism=options.realism)
    sensor_timing.report()


if __name__ == "__main__":
    main()
