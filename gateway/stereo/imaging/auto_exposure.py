"""Automatic exposure and its modes. Unlike the device's, it does not take several frames to adapt.

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

from gateway.stereo.device.stream_settings import AutoExposure, StreamSettings
from renderers.stereo.sensor.exposure import REFERENCE_EXPOSURE, Exposure

METERING_DIVISOR: Final = 8
"""Width of the camera images divided by that of the metered image."""
MIN_EXPOSURE: Final = 6.6e-5
"""The device's shortest exposure time, seconds."""
MAX_GAIN: Final = 18.0
"""The device's highest gain, dB."""
SATURATED_SHARE: Final = 0.01
"""Maximum share of saturated pixels before automatic exposure lowers its brightness target."""
_SEARCH_STEPS: Final = 12
"""Steps of the search for an exposure. Each quarters the range, to 2e-6 of the reference exposure at last."""
_HISTOGRAM_BINS: Final = 2048
"""Bins of the light's histogram: a resolution of 1/2000 of the brightest value."""


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


def auto_exposure(light: NDArray[np.float32], limits: AutoExposure, manual: Exposure | None = None) -> Exposure:
    """Return the exposure time and gain for an image: the longest time first, then gain.

    The result depends on this image only, as if automatic exposure had settled on it.

    Args:
        light: float32 of any shape, 1 is white; a downscaled image suffices.
        limits: limits and targets.
        manual: exposure whose gamma, dynamic range and white balance are kept; None: the default exposure.
    """
    manual = manual or Exposure()
    max_time = max(limits.max_time, MIN_EXPOSURE)
    # The searches below evaluate the mean brightness at 36 factors each, so they use a histogram instead of the image.
    brightest = max(float(light.max()), 1e-6)
    bins = (light.reshape(-1) * np.float32((_HISTOGRAM_BINS - 1) / brightest) + np.float32(0.5)).astype(np.int32)
    all_counts = np.bincount(bins)
    occupied = np.flatnonzero(all_counts)
    counts = all_counts[occupied].astype(np.float64)
    levels = occupied * (brightest / (_HISTOGRAM_BINS - 1))

    def factor_for_mean(target: float) -> float:
        """Return the ``Exposure.light`` at which the mean of the image is ``target``."""
        low, high = MIN_EXPOSURE / REFERENCE_EXPOSURE, Exposure(max_time, MAX_GAIN).light
        for _ in range(_SEARCH_STEPS):
            middle = 0.5 * (low + high)
            edges = low, 0.5 * (low + middle), middle, 0.5 * (middle + high), high
            means = manual.response(np.outer(edges[1:-1], levels)) @ counts / light.size
            quarter = int(means.searchsorted(target))
            low, high = edges[quarter : quarter + 2]
        return 0.5 * (low + high)

    factor = factor_for_mean(limits.average_max)
    unsaturated = (1.0 - SATURATED_SHARE) * light.size
    brightest_unsaturated = max(float(levels[np.searchsorted(np.cumsum(counts), unsaturated)]), 1e-6)
    if brightest_unsaturated * factor > manual.saturation:
        factor = max(manual.saturation / brightest_unsaturated, min(factor_for_mean(limits.average_min), factor))
    time = min(max(factor * REFERENCE_EXPOSURE, MIN_EXPOSURE), max_time)
    gain = min(max(20.0 * float(np.log10(factor * REFERENCE_EXPOSURE / time)), 0.0), MAX_GAIN)
    return Exposure(time, 0.0 if gain < 0.01 else gain, manual.gamma, manual.hdr, manual.red, manual.blue)
