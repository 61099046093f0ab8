"""Modes of automatic exposure. Unlike the device's, it does not take several frames to adapt.

* ``Normal``: every image is metered by itself. In alternate exposure, the image with Out1 high determines both
  exposures.
* ``Out1High``: only images with Out1 high are metered. Images with Out1 low get the exposure of the last one metered.
* ``AdaptiveOut1``: images with Out1 low are exposed less, so that nothing is over-exposed when Out1 goes high.
  ``out1_reduction`` is the share by which they are exposed less, 0 to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.stereo.device.stream_settings import StreamSettings
from renderers.stereo.sensor.exposure import Exposure, auto_exposure

METERING_DIVISOR: Final = 8
"""Width of the camera images divided by that of the metered image."""


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
        unlit: (h, w) float32, light of the left image at 1/``METERING_DIVISOR`` of the resolution, 1 is white, without
            the projector's light.
        lit: (h, w) float32, the same with the projector's light.
        out1_high: True if Out1 is high in this image.
        settings: parameters of the frame.
        memory: state between frames; updated.
    """
    limits, manual = settings.auto_exposure, settings.manual_exposure
    if limits is None:
        return manual, 0.0
    unlit, lit = _metered_region(unlit, settings), _metered_region(lit, settings)
    if settings.auto_exposure_mode == "AdaptiveOut1":
        unlit_exposure, lit_exposure = auto_exposure(unlit, limits, manual), auto_exposure(lit, limits, manual)
        return lit_exposure, min(max(1.0 - lit_exposure.light / unlit_exposure.light, 0.0), 1.0)
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
    inside = values[region.slices(METERING_DIVISOR)]
    return inside if inside.size else values
