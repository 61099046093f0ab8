"""Plot of the error of one point of a wall over 50 frames, for the documentation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from bench.sensor_images import Sample
from bench.sensor_time import DISTANCE, Camera, deviation_of, time_scenes
from renderers.stereo.depth.depth_images import DepthImages

FRAMES: Final = 50
"""Number of frames."""
SPEED: Final = 0.2
"""Motion of the image while the camera moves, pixels per frame at ``DISTANCE``."""
POINT: Final = (250, 330)
"""Row and column of the point before the motion."""
WIDTH: Final = 900
HEIGHT: Final = 220
"""Size of a panel, pixels."""
RANGE: Final = 0.4
"""Largest error of a panel, pixels of the depth image."""
COLOURS: Final = ((180, 111, 31), (43, 130, 217))
"""BGR of the lines of a static and of a moving camera."""
MARGIN: Final = 50


def errors_of_a_point(measure: dict[str, Callable[[Sample], DepthImages]], speed: float) -> dict[str, list[float]]:
    """Return the errors of the point in each frame by mode, pixels, NaN: no depth.

    Args:
        measure: function that makes the depth images of a sample, by mode.
        speed: motion of the image along x, pixels per frame at ``DISTANCE``.
    """
    camera, scene = Camera(realism=False), next(time_scenes())
    errors: dict[str, list[float]] = {mode: [] for mode in measure}
    row, column = POINT
    shift = speed
    for frame in range(FRAMES):
        sample = camera.sample(scene, frame, frame * speed)
        if frame == 0:
            factor = sample.imaging.config.model.focal_times_baseline(sample.settings.quality.divisor)
            shift = speed * DISTANCE * float(sample.exact[row, column]) / factor
        for mode, function in measure.items():
            errors[mode].append(float(deviation_of(sample, function(sample))[row, round(column + frame * shift)]))
    return errors


def panel(title: str, lines: list[list[float]]) -> NDArray[np.uint8]:
    """Return an image of the errors over time, (``HEIGHT``, ``WIDTH``, 3) uint8 BGR."""
    image = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)

    def text(value: str, x: int, y: int) -> None:
        cv2.putText(image, value, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (60, 60, 60), 1, cv2.LINE_AA)

    def y_of(error: float) -> int:
        return round(HEIGHT / 2 + 8 - error / RANGE * (HEIGHT / 2 - 26))

    for error in (-RANGE, -RANGE / 2, 0.0, RANGE / 2, RANGE):
        cv2.line(image, (MARGIN, y_of(error)), (WIDTH - 10, y_of(error)), (225, 225, 225), 1)
        text(f"{error:+.1f}", 8, y_of(error) + 4)
    for errors, colour in zip(lines, COLOURS, strict=True):
        x = np.linspace(MARGIN, WIDTH - 10, len(errors)).astype(int)
        points = [(int(a), y_of(e)) for a, e in zip(x, errors, strict=True) if np.isfinite(e)]
        cv2.polylines(image, [np.array(points, np.int32)], False, colour, 2, cv2.LINE_AA)
    text(title, MARGIN, 14)
    return image


def write_plot(file: Path, measure: dict[str, Callable[[Sample], DepthImages]]) -> None:
    """Write the image, one panel for each mode."""
    still, moving = errors_of_a_point(measure, 0.0), errors_of_a_point(measure, SPEED)
    panels = [
        panel(
            f"{mode}: error in pixels, {FRAMES} frames; blue: static, orange: camera moves {SPEED:g} pixels a frame",
            [still[mode], moving[mode]],
        )
        for mode in measure
    ]
    cv2.imwrite(str(file), np.vstack(panels), [cv2.IMWRITE_WEBP_QUALITY, 85])
