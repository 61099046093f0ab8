"""Which exposure the images of a shot get: the device's modes of automatic exposure.

The manual's sentences, with an automatic that has settled in every frame:

* ``Normal``: every image for itself; in alternate exposure those with Out1 high decide for both.
* ``Out1High``: only images with Out1 high are looked at; those with Out1 low get the exposure of the last of them.
* ``AdaptiveOut1``: images with Out1 low are exposed less, by the difference that Out1 makes, so that nothing is
  over-exposed when it goes high. The share is ``out1_reduction``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.settings import StreamSettings
from renderers.stereo.exposure import Exposure, auto_exposure


@dataclass(slots=True)
class Memory:
    """What the automatic remembers from frame to frame."""

    high: Exposure | None = None
    """Of the last image with Out1 high."""


def expose(
    dark: NDArray[np.float32], bright: NDArray[np.float32], *, high: bool, settings: StreamSettings, memory: Memory
) -> tuple[Exposure, float]:
    """The exposure of a shot, and ``out1_reduction``.

    Args:
        dark: (h, w) float32 brightness (``brightness_of``) of what the left camera sees, at a lower resolution.
        bright: the same with the light that Out1 switches.
        high: whether Out1 is high in this shot.
        settings: of the frame.
        memory: of earlier frames; changed.
    """
    limits, like = settings.auto, settings.manual
    if limits is None:
        return like, 0.0
    dark, bright = (_within(values, settings) for values in (dark, bright))

    def best(values: NDArray[np.float32]) -> Exposure:
        return auto_exposure(values, limits, like)

    if settings.auto_mode == "AdaptiveOut1":
        low, lit = best(dark), best(bright)
        return lit, min(max(1.0 - lit.light / low.light, 0.0), 1.0)
    if settings.auto_mode == "Out1High":
        if high or memory.high is None:
            memory.high = best(bright)
        return memory.high, 0.0
    return best(bright if high or settings.alternate else dark), 0.0


def _within(values: NDArray[np.float32], settings: StreamSettings) -> NDArray[np.float32]:
    """What lies in the exposure region; everything when that is empty."""
    region = settings.exposure_region
    if region is None:
        return values
    columns, rows = span(region[0], region[2], DIVISOR), span(region[1], region[3], DIVISOR)
    inside = values[rows, columns]
    return inside if inside.size else values


def span(begin: int, size: int, divisor: int) -> slice:
    """Pixels of an image at 1/``divisor`` of the resolution that lie at least partly in a span of the full image."""
    return slice(begin // divisor, -(-(begin + size) // divisor))


DIVISOR = 8
"""Automatic exposure looks at a picture this much smaller than the camera's."""
