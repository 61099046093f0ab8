"""How an image is taken: exposure time, gain, gamma, white balance, high dynamic range, and the automatic.

A rendered picture has no physical brightness. Our definition: at 5 ms, 0 dB, gamma 1 the image is the picture as
rendered; light grows linearly with the exposure time and with 10^(gain / 20), so the encoded value with its power
1/2.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

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
BRACKETS: Final = (0.25, 1.0, 4.0)
"""High dynamic range: the exposure times that are combined, in units of the automatic one. The device's are not
published."""
_BINS: Final = 2048
"""Of the histogram of brightness; twice as fine as needed for 1/1000 of the exposure."""


@dataclass(frozen=True, slots=True)
class Exposure:
    """How an image is taken."""

    time: float = REFERENCE_EXPOSURE
    """Seconds."""
    gain: float = 0.0
    """dB"""
    gamma: float = 1.0
    hdr: bool = False
    """Three exposures are combined, and the result is compressed into the range of the image."""
    red: float = 1.0
    """White balance: factor of red light."""
    blue: float = 1.0

    @property
    def light(self) -> float:
        """Relative to the reference exposure."""
        return self.time / REFERENCE_EXPOSURE * float(10.0 ** (self.gain / 20.0))

    @property
    def factor(self) -> float:
        """By which the display-encoded picture is multiplied."""
        return float(self.light ** (1.0 / DISPLAY_GAMMA))

    @property
    def full(self) -> float:
        """Multiplied display-encoded value at which the image saturates."""
        return float(BRACKETS[0] ** (-1.0 / DISPLAY_GAMMA)) if self.hdr else 1.0

    @property
    def channels(self) -> NDArray[np.float64]:
        """(3,) factors of display-encoded red, green and blue."""
        return np.array((self.red, 1.0, self.blue)) ** (1.0 / DISPLAY_GAMMA)

    def response(self, x: NDArray[np.floating]) -> NDArray[np.floating]:
        """Brightness in the image, 0 to 1, of multiplied display-encoded values.

        High dynamic range is compressed by Reinhard's extended operator (2002) with white at ``full``.
        """
        x = np.minimum(x, self.full)
        if self.hdr:
            x = x * (1.0 + x / self.full**2) / (1.0 + x)
        curved: NDArray[np.floating] = x ** (1.0 / self.gamma)
        return curved

    def sigma(self, grey: float) -> float:
        """Noise of a grey value of one exposure, levels."""
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
    picture: NDArray[np.uint8],
    dots: NDArray[np.uint8] | None = None,
    dot_light: float = 0.0,
    channels: NDArray[np.float64] | None = None,
) -> NDArray[np.float32]:
    """(H, W) float32 display-encoded brightness of a rendered picture as ``take`` sees it at factor 1; 1 is full scale.

    Arguments as for ``take``; ``channels`` as of an ``Exposure``.
    """
    weights = LUMA if channels is None else LUMA * channels
    luma: NDArray[np.float32] = picture.astype(np.float32) @ (weights / 255.0).astype(np.float32)
    if dots is not None:
        luma *= (1.0 + dot_light / 255.0 * dots.astype(np.float32)) ** np.float32(1.0 / DISPLAY_GAMMA)
    return luma


def auto_exposure(values: NDArray[np.float32], limits: AutoExposure, like: Exposure | None = None) -> Exposure:
    """Time and gain for a picture, longest time first, then gain; the same picture gives the same answer.

    Args:
        values: float32 of ``brightness_of``; of a small picture is enough.
        limits: see ``AutoExposure``.
        like: gamma, dynamic range and white balance, which the answer keeps; None: the defaults.
    """
    like = like or Exposure()
    longest = max(limits.max_time, MIN_EXPOSURE)
    lowest = Exposure(MIN_EXPOSURE).factor
    highest = Exposure(longest, MAX_GAIN).factor
    # A histogram: the search looks at the picture some fifty times.
    top = max(float(values.max()), 1e-6)
    steps = (values.reshape(-1) * np.float32((_BINS - 1) / top) + np.float32(0.5)).astype(np.int32)
    counts = np.bincount(steps, minlength=_BINS)
    levels = np.arange(_BINS) * (top / (_BINS - 1))

    def search(target: float) -> float:
        low, high = lowest, highest
        for _ in range(24):
            middle = 0.5 * (low + high)
            brightness = float(np.dot(like.response(levels * middle), counts)) / values.size
            low, high = (middle, high) if brightness < target else (low, middle)
        return 0.5 * (low + high)

    factor = search(limits.average_max)
    bright = max(float(levels[np.searchsorted(np.cumsum(counts), (1.0 - SATURATED_SHARE) * values.size)]), 1e-6)
    if bright * factor > like.full:
        factor = max(like.full / bright, min(search(limits.average_min), factor))
    light = factor**DISPLAY_GAMMA
    time = min(max(light * REFERENCE_EXPOSURE, MIN_EXPOSURE), longest)
    gain = min(max(20.0 * float(np.log10(light * REFERENCE_EXPOSURE / time)), 0.0), MAX_GAIN)
    return Exposure(time, 0.0 if gain < 0.01 else gain, like.gamma, like.hdr, like.red, like.blue)
