"""Modes of automatic exposure, which has settled in every frame.

* ``Normal``: every image is metered by itself; in alternate exposure, the image with Out1 high determines both.
* ``Out1High``: only images with Out1 high are metered; those with Out1 low get the exposure of the last one.
* ``AdaptiveOut1``: images with Out1 low are exposed less, so that nothing is over-exposed when Out1 goes high.
  ``out1_reduction`` is the share by which they are exposed less.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.settings import StreamSettings
from renderers.stereo.exposure import Exposure, auto_exposure

DIVISOR: Final = 8
"""Resolution of the camera images divided by that of the metered image."""


@dataclass(slots=True)
class ExposureMemory:
    """State of automatic exposure between frames."""

    out1_high: Exposure | None = None
    """Exposure of the last image with Out1 high."""


def choose_exposure(
    unlit: NDArray[np.float32],
    lit: NDArray[np.float32],
    *,
    out1_high: bool,
    settings: StreamSettings,
    memory: ExposureMemory,
) -> tuple[Exposure, float]:
    """Return the exposure of an image and ``out1_reduction``.

    Args:
        unlit: (h, w) float32, ``brightness_of`` the left image at 1/``DIVISOR`` of the resolution, without the light of
            the projector on Out1.
        lit: (h, w) float32, the same with that light.
        out1_high: True if Out1 is high in this image.
        settings: parameters of the frame.
        memory: state, changed.
    """
    limits, manual = settings.auto_exposure, settings.manual_exposure
    if limits is None:
        return manual, 0.0
    unlit, lit = _metered_region(unlit, settings), _metered_region(lit, settings)
    if settings.auto_exposure_mode == "AdaptiveOut1":
        low, high = auto_exposure(unlit, limits, manual), auto_exposure(lit, limits, manual)
        return high, min(max(1.0 - high.light / low.light, 0.0), 1.0)
    if settings.auto_exposure_mode == "Out1High":
        if out1_high or memory.out1_high is None:
            memory.out1_high = auto_exposure(lit, limits, manual)
        return memory.out1_high, 0.0
    return auto_exposure(lit if out1_high or settings.alternate_exposure else unlit, limits, manual), 0.0


def _metered_region(values: NDArray[np.float32], settings: StreamSettings) -> NDArray[np.float32]:
    """Return the pixels of the exposure region, or the whole image if the region lies outside."""
    region = settings.exposure_region
    if region is None:
        return values
    inside = values[region.slices(DIVISOR)]
    return inside if inside.size else values
