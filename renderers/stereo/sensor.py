"""From a rendered colour picture to what the camera's sensor would give: exposure, gain, gamma, noise, saturation.

Conventions of our own, since a rendered picture has no physical unit:

* at ``REFERENCE_EXPOSURE`` and 0 dB the image is the picture as rendered (display-encoded; the device's gamma 1);
* light grows linearly with exposure time and with 10^(gain / 20), so the encoded value with its power 1/2.2;
* the noise of a grey value v in levels is sqrt(a^2 + b g v) with g = 10^(gain / 20), read noise a = 0.2 g and shot
  noise b = 0.0004: about 0.3 levels at mid grey and 0 dB, which is what recorded images of a device show.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.stereo import sensor_kernels as kernels
from renderers.stereo.noise import NORMAL_TABLE

REFERENCE_EXPOSURE: Final = 0.005
"""Seconds; the device's default of exp_value."""
DISPLAY_GAMMA: Final = 2.2
LUMA: Final = np.array((0.299, 0.587, 0.114))
"""Rec. 601 weights of red, green and blue."""
READ_NOISE: Final = 0.2
SHOT_NOISE: Final = 0.0004
MIN_EXPOSURE: Final = 6.6e-5
"""Seconds, the device's shortest exposure."""
MAX_GAIN: Final = 18.0
"""dB"""
SATURATED_SHARE: Final = 0.01
"""Automatic exposure: at most this share of the pixels may saturate before the brightness target is lowered."""
_BINS: Final = 2048
"""Of the histogram of brightness; twice as fine as needed for 1/1000 of the exposure."""
_GREYS: Final = 1024
"""Steps of luma; finer than the levels of the image, so that rounding adds no bands."""


def _quantiles() -> NDArray[np.float32]:
    groups = NORMAL_TABLE.reshape(128, -1).mean(axis=1)
    return np.asarray(groups / groups.std(), np.float32)


_QUANTILES: Final = _quantiles()
"""(128,) float32: the standard normal's quantiles, coarser than ``NORMAL_TABLE``."""


@dataclass(frozen=True, slots=True)
class Exposure:
    """How an image is taken."""

    time: float = REFERENCE_EXPOSURE
    """Seconds."""
    gain: float = 0.0
    """dB"""
    gamma: float = 1.0

    @property
    def factor(self) -> float:
        """By which the display-encoded picture is multiplied."""
        light = self.time / REFERENCE_EXPOSURE * 10.0 ** (self.gain / 20.0)
        return float(light ** (1.0 / DISPLAY_GAMMA))

    def sigma(self, grey: float) -> float:
        """Noise of a grey value, levels."""
        amplification = 10.0 ** (self.gain / 20.0)
        return float(np.sqrt((READ_NOISE * amplification) ** 2 + SHOT_NOISE * amplification * grey))


@dataclass(frozen=True, slots=True)
class AutoExposure:
    """The device's parameters of automatic exposure."""

    max_time: float = 0.018
    """exp_max, seconds."""
    average_max: float = 0.75
    """Mean brightness aimed at while nothing saturates."""
    average_min: float = 0.25
    """Mean brightness below which saturation does not darken the image further."""


def brightness_of(
    picture: NDArray[np.uint8], dots: NDArray[np.uint8] | None = None, dot_light: float = 0.0
) -> NDArray[np.float32]:
    """(N,) float32 display-encoded brightness of a rendered picture as ``take`` sees it at factor 1; 1 is full scale.

    Arguments as for ``take``.
    """
    luma: NDArray[np.float32] = picture.reshape(-1, 3).astype(np.float32) @ (LUMA / 255.0).astype(np.float32)
    if dots is not None:
        luma *= (1.0 + dot_light / 255.0 * dots.reshape(-1).astype(np.float32)) ** np.float32(1.0 / DISPLAY_GAMMA)
    return luma


def auto_exposure(values: NDArray[np.float32], limits: AutoExposure, gamma: float = 1.0) -> Exposure:
    """Time and gain for a picture, longest time first, then gain; the same picture gives the same answer.

    Args:
        values: (N,) float32 of ``brightness_of``; of a small picture is enough.
        limits: see ``AutoExposure``.
        gamma: kept in the answer and respected by the brightness.
    """
    longest = max(limits.max_time, MIN_EXPOSURE)
    lowest = Exposure(MIN_EXPOSURE).factor
    highest = Exposure(longest, MAX_GAIN).factor

    # A histogram: the search looks at the picture some fifty times.
    top = max(float(values.max()), 1e-6)
    counts = np.bincount((values * np.float32((_BINS - 1) / top) + np.float32(0.5)).astype(np.int32), minlength=_BINS)
    levels = np.arange(_BINS) * (top / (_BINS - 1))

    def brightness(factor: float) -> float:
        return float(np.dot(np.minimum(levels * factor, 1.0) ** (1.0 / gamma), counts)) / len(values)

    def search(target: float) -> float:
        low, high = lowest, highest
        for _ in range(24):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if brightness(middle) < target else (low, middle)
        return 0.5 * (low + high)

    factor = search(limits.average_max)
    bright = float(levels[np.searchsorted(np.cumsum(counts), (1.0 - SATURATED_SHARE) * len(values))])
    if bright * factor > 1.0:
        factor = max(1.0 / bright, min(search(limits.average_min), factor))
    light = factor**DISPLAY_GAMMA
    time = min(max(light * REFERENCE_EXPOSURE, MIN_EXPOSURE), longest)
    gain = min(max(20.0 * float(np.log10(light * REFERENCE_EXPOSURE / time)), 0.0), MAX_GAIN)
    return Exposure(time, 0.0 if gain < 0.01 else gain, gamma)


@dataclass(frozen=True, slots=True)
class Taken:
    """One image of the sensor."""

    image: NDArray[np.uint8]
    """(H, W) or (H, W, 3) uint8."""
    brightness: float
    """Mean of the image, 0 to 1."""


def take(
    picture: NDArray[np.uint8],
    exposure: Exposure,
    key: np.uint64,
    *,
    color: bool,
    dots: NDArray[np.uint8] | None = None,
    dot_light: float = 0.0,
    noise: float = 1.0,
) -> Taken:
    """The image that the sensor gives of a rendered picture.

    Args:
        picture: (H, W, 3) uint8 RGB, C-contiguous.
        exposure: how it is taken.
        key: of this frame and camera (``noise.frame_key``).
        color: RGB; else grey by Rec. 601 luma.
        dots: (H, W) uint8 light of the projector at each pixel, 255 is full; None: the projector is off.
        dot_light: light that a full dot adds, relative to the scene's own.
        noise: factor of its standard deviation; 0: none.
    """
    height, width = picture.shape[:2]
    image = np.empty((height, width, 3) if color else (height, width), np.uint8)
    words = np.uint64(key)
    if dots is None:
        table = _noisy_levels(exposure, noise, 256 if color else _GREYS)
        total = (kernels.color_by_table if color else kernels.grey_by_table)(picture, table, words, image)
    else:
        response, sigma = _curves(exposure, noise)
        lit = (
            (1.0 + dot_light * np.arange(256) / 255.0) ** (1.0 / DISPLAY_GAMMA) * exposure.factor * (kernels.STEPS - 1)
        )
        draw = kernels.color_with_dots if color else kernels.grey_with_dots
        total = draw(picture, dots, lit.astype(np.float32), response, sigma, NORMAL_TABLE, words, image)
    return Taken(image, total / (255.0 * image.size))


def _noisy_levels(exposure: Exposure, noise: float, inputs: int) -> NDArray[np.uint8]:
    """(inputs, 128) uint8: grey value of a display-encoded value, for each of 128 equally likely noises."""
    response, sigma = _curves(exposure, noise)
    values = np.arange(inputs, dtype=np.float32) / (inputs - 1) * np.float32(exposure.factor * (kernels.STEPS - 1))
    step = np.minimum(values, kernels.STEPS - 1).astype(np.int32)
    levels = response[step][:, None] + sigma[step][:, None] * _QUANTILES
    return np.clip(levels, 0.0, 255.0).astype(np.uint8)


def _curves(exposure: Exposure, noise: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(4096,) float32 grey value and (4096,) float32 noise of a linear step of the display-encoded value."""
    grey = 255.0 * (np.arange(kernels.STEPS) / (kernels.STEPS - 1)) ** (1.0 / exposure.gamma)
    amplification = 10.0 ** (exposure.gain / 20.0)
    sigma = np.sqrt((READ_NOISE * amplification) ** 2 + SHOT_NOISE * amplification * grey) * noise
    return (grey + 0.5).astype(np.float32), sigma.astype(np.float32)
