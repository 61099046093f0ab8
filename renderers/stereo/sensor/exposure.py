"""Exposure: time, gain and response of a camera image, and automatic exposure.

Rendered images have no physical brightness. By our definition an exposure of 5 ms at 0 dB makes rendered white, which
is light 1, just white. Light grows linearly with the exposure time and with 10^(gain / 20). An image shows the light to
the power of gamma, as in the device's manual: 1 is a linear response, and lower values brighten dark parts. The noise
(``noise_sigma``) is about 0.3 grey levels at mid grey and 0 dB, as in images recorded with a device.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

REFERENCE_EXPOSURE: Final = 0.005
"""Exposure time at which rendered white is white, seconds: the device's default of exp_value."""
DISPLAY_GAMMA: Final = 2.2
"""Light is the value of a rendered image, 0 to 1, to this power: the encoding of the look ``gltf``."""
LIGHT_OF_LEVEL: Final = (np.arange(256) / 255.0) ** DISPLAY_GAMMA
"""(256,) float64, light of each level of a rendered image; 1 is white."""
LIGHT_WHITE: Final = 16384
"""Value of white in a light image (``camera_image``), the square root of its light."""
LUMA: Final = np.array((0.299, 0.587, 0.114))
"""Rec. 601 weights of red, green and blue."""
READ_NOISE: Final = 0.2
"""Standard deviation of the read noise at 0 dB, grey levels."""
SHOT_NOISE: Final = 0.0004
"""Variance of the shot noise per grey level at 0 dB."""
MIN_EXPOSURE: Final = 6.6e-5
"""The device's shortest exposure time, seconds."""
MAX_GAIN: Final = 18.0
"""The device's highest gain, dB."""
SATURATED_SHARE: Final = 0.01
"""Maximum share of saturated pixels before automatic exposure lowers its brightness target."""
BRIGHT_SHARE: Final = 0.05
"""Likewise of bright pixels: vignetting makes the middle of a plain room 1.3 times as bright as the mean."""
BRIGHT: Final = 0.82
"""Brightness above which pixels are bright, 1 is saturation. It is more, up to 1, where the target would saturate more
than the share: a bright sky does not darken the ground."""
_SEARCH_STEPS: Final = 12
"""Steps of the search for an exposure. Each quarters the range, to 2e-6 of the reference exposure at last."""
_HISTOGRAM_BINS: Final = 2048
"""Bins of the light's histogram: a resolution of 1/2000 of the brightest value."""
RESPONSE_STEPS: Final = 2048
"""Number of samples of ``Exposure.response_table``."""
BRACKETS: Final = (0.25, 1.0, 4.0)
"""Exposure times that a high dynamic range image combines, relative to the automatic one. Our choice: the device's
are not published."""


@dataclass(frozen=True)
class Exposure:
    """Settings that turn a rendered image into a camera image."""

    time: float = REFERENCE_EXPOSURE
    """Seconds."""
    gain: float = 0.0
    """dB."""
    gamma: float = 1.0
    """Power of the light that the image shows: 1 is linear, 0.5 is brighter and resembles the human eye."""
    hdr: bool = False
    """Combine three exposures and compress the result into the range of the image."""
    red: float = 1.0
    """White balance: factor of red light."""
    blue: float = 1.0
    """White balance: factor of blue light."""

    @cached_property
    def amplification(self) -> float:
        """``gain`` as a factor."""
        return float(10.0 ** (self.gain / 20.0))

    @cached_property
    def light(self) -> float:
        """Amplified light, relative to the reference exposure."""
        return self.time / REFERENCE_EXPOSURE * self.amplification

    @cached_property
    def saturation(self) -> float:
        """Amplified light at which the image saturates."""
        return 1.0 / BRACKETS[0] if self.hdr else 1.0

    @cached_property
    def channel_factors(self) -> NDArray[np.float64]:
        """(3,) float64, white balance as factors of red, green and blue light."""
        return np.array((self.red, 1.0, self.blue))

    def response(self, light: NDArray[np.floating], *, clip: bool = True) -> NDArray[np.floating]:
        """Return the brightness in the image, 0 to 1, of amplified light; ``clip`` False: of a sensor that never
        saturates.

        High dynamic range is compressed by Reinhard's extended operator (2002) with white at ``saturation``.
        """
        if clip:
            light = np.minimum(light, self.saturation)
        if self.hdr:
            light = light * (1.0 + light / self.saturation**2) / (1.0 + light)
        brightness: NDArray[np.floating] = light**self.gamma
        return brightness

    @cached_property
    def response_table(self) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Grey level plus 0.5, for rounding, and standard deviation of the noise in grey levels.

        Both have ``RESPONSE_STEPS`` elements: equal steps of the square root of the amplified light, up to saturation.
        """
        light = (np.arange(RESPONSE_STEPS) / (RESPONSE_STEPS - 1)) ** 2 * self.saturation
        sigma = self._hdr_noise_sigma(light) if self.hdr else noise_sigma(255.0 * light, self.amplification) / 255.0
        brighter = self.response(np.maximum(light + sigma, 0.0), clip=False)
        darker = self.response(np.maximum(light - sigma, 0.0), clip=False)
        grey = 255.0 * self.response(light) + 0.5
        return grey.astype(np.float32), 127.5 * (brighter - darker)

    def _hdr_noise_sigma(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the standard deviation of the noise in a high dynamic range image before compression.

        The image is the mean of three exposures. Each exposure is weighted by its distance from black and white.
        """
        weight_sum, variance = np.zeros_like(light), np.zeros_like(light)
        for bracket in BRACKETS:
            exposed = np.minimum(light * bracket, 1.0)
            weight = np.maximum(1.0 - (2.0 * exposed - 1.0) ** 12, 1e-3) * np.where(exposed < 1.0, bracket**2, 1e-6)
            weight_sum += weight
            variance += (weight * noise_sigma(255.0 * exposed, self.amplification) / 255.0 / bracket) ** 2
        sigma: NDArray[np.float64] = np.sqrt(variance) / weight_sum
        return sigma

    @cached_property
    def noise_by_level(self) -> NDArray[np.float64]:
        """(256,) float64, standard deviation of the noise at each grey level, grey levels."""
        grey, noise = self.response_table
        return np.interp(np.arange(256.0), grey - np.float32(0.5), noise)

    @property
    def mid_grey_noise(self) -> float:
        """Standard deviation of the noise at mid grey, grey levels."""
        return float(self.noise_by_level[128])


def noise_sigma(grey: NDArray[np.floating] | float, amplification: float) -> Any:
    """Return the standard deviation of the noise at grey values of a linear response, grey levels.

    The variance of grey value v at amplification g is (0.2 g)^2 + 0.0004 g v: read noise and shot noise.
    """
    return np.sqrt((READ_NOISE * amplification) ** 2 + SHOT_NOISE * amplification * grey)


@dataclass(frozen=True, slots=True)
class AutoExposure:
    """Limits and targets of automatic exposure."""

    max_time: float = 0.018
    """Longest exposure time (exp_max), seconds."""
    average_max: float = 0.75
    """Target of the mean brightness while nothing saturates, 0 to 1."""
    average_min: float = 0.25
    """Mean brightness, 0 to 1, below which the image is not darkened to avoid saturation."""


def auto_exposure(light: NDArray[np.float32], limits: AutoExposure, manual: Exposure | None = None) -> Exposure:
    """Return the exposure time and gain for an image: the longest time first, then gain.

    The result depends on this image only, as if automatic exposure had settled on it.

    Args:
        light: of any shape, 1 is white; a downscaled image suffices.
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
    shares = np.array((1.0 - SATURATED_SHARE, 1.0 - BRIGHT_SHARE))
    unsaturated, not_bright = levels[np.searchsorted(np.cumsum(counts), shares * light.size)].tolist()
    bright = BRIGHT ** (1.0 / manual.gamma)
    bright = min(max(bright, bright * unsaturated * factor / manual.saturation), 1.0)
    highest = max(unsaturated, not_bright / bright, 1e-6)
    if highest * factor > manual.saturation:
        factor = max(manual.saturation / highest, min(factor_for_mean(limits.average_min), factor))
    time = min(max(factor * REFERENCE_EXPOSURE, MIN_EXPOSURE), max_time)
    gain = min(max(20.0 * float(np.log10(factor * REFERENCE_EXPOSURE / time)), 0.0), MAX_GAIN)
    return Exposure(time, 0.0 if gain < 0.01 else gain, manual.gamma, manual.hdr, manual.red, manual.blue)
