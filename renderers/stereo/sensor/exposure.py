"""Exposure: turns a light image of ``optics`` into a camera image with gain, noise, saturation and gamma.

Rendered images have no physical brightness. By our definition an exposure of 5 ms at 0 dB makes rendered white, which
is light 1, just white. Light grows linearly with the exposure time and with 10^(gain / 20). An image shows the light to
the power of gamma, as in the device's manual: 1 is a linear response, and lower values brighten dark parts. The noise
(``noise_sigma``) is about 0.3 grey levels at mid grey and 0 dB, as in images recorded with a device.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.stereo.sensor.fixed_pattern import GAIN_UNIT, OFFSET_UNIT, FixedPattern
from renderers.stereo.sensor.noise import NORMAL_TABLE
from renderers.stereo.sensor.sensor_kernels import RESPONSE_STEPS, expose_light

REFERENCE_EXPOSURE: Final = 0.005
"""Exposure time at which rendered white is white, seconds: the device's default of exp_value."""
DISPLAY_GAMMA: Final = 2.2
"""Light is the value of a rendered image, 0 to 1, to this power: the encoding of the look ``gltf``."""
LIGHT_OF_LEVEL: Final = (np.arange(256) / 255.0) ** DISPLAY_GAMMA
"""(256,) float64, light of each level of a rendered image; 1 is white."""
LIGHT_WHITE: Final = 16384
"""Value of white in a light image (``lens.optics``), the square root of its light."""
LUMA: Final = np.array((0.299, 0.587, 0.114))
"""Rec. 601 weights of red, green and blue."""
READ_NOISE: Final = 0.2
"""Standard deviation of the read noise at 0 dB, grey levels."""
SHOT_NOISE: Final = 0.0004
"""Variance of the shot noise per grey level at 0 dB."""
BRACKETS: Final = (0.25, 1.0, 4.0)
"""Exposure times that a high dynamic range image combines, relative to the automatic one. Our choice: the device's
are not published."""
_GROUP_MEANS: Final = NORMAL_TABLE.reshape(128, -1).mean(axis=1)
"""(128,) float32, means of groups of neighbouring quantiles."""
_NOISE_QUANTILES: Final = np.asarray(_GROUP_MEANS / _GROUP_MEANS.std(), np.float32)
"""(128,) float32, quantiles of the standard normal distribution, coarser than ``NORMAL_TABLE``."""
_NO_PATTERN: Final = FixedPattern(np.zeros((1, 1), np.int8), np.zeros((1, 1), np.int8))


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
        """Return the brightness in the image, 0 to 1, of amplified light.

        High dynamic range is compressed by Reinhard's extended operator (2002) with white at ``saturation``.

        Args:
            clip: False: a sensor that never saturates.
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
    def mid_grey_noise(self) -> float:
        """Standard deviation of the noise at mid grey, grey levels."""
        return self.noise_sigma(128.0)

    def noise_sigma(self, grey: float) -> float:
        """Return the standard deviation of the noise in one exposure at a grey value of the image, grey levels."""
        light = (grey / 255.0) ** (1.0 / self.gamma)
        sigma = noise_sigma(255.0 * light, self.amplification) / 255.0
        return float(127.5 * ((light + sigma) ** self.gamma - max(light - sigma, 0.0) ** self.gamma))


def noise_sigma(grey: NDArray[np.floating] | float, amplification: float) -> Any:
    """Return the standard deviation of the noise at grey values of a linear response, grey levels.

    The variance of grey value v at amplification g is (0.2 g)^2 + 0.0004 g v: read noise and shot noise.
    """
    return np.sqrt((READ_NOISE * amplification) ** 2 + SHOT_NOISE * amplification * grey)


@dataclass(frozen=True, slots=True)
class SensorImage:
    """One camera image."""

    image: NDArray[np.uint8]
    """(H, W) or (H, W, 3) uint8."""
    brightness: float
    """Mean of the image, 0 to 1."""


def image_from_light(
    light: NDArray[np.uint16],
    exposure: Exposure,
    key: np.uint64,
    pattern: FixedPattern | None = None,
    noise_factor: float = 1.0,
) -> SensorImage:
    """Return the camera image of a light image.

    Args:
        light: (H, W, 3 or 1) uint16, ``optics.light_on_sensor`` with the white balance of ``exposure``.
        exposure: exposure; the white balance is not applied again.
        key: random key of this frame and camera (``noise.frame_key``).
        pattern: fixed pattern of the sensor; None: all pixels are alike.
        noise_factor: factor of the noise's standard deviation; 0 disables noise, but not the fixed pattern.
    """
    image = np.empty(light.shape, np.uint8)
    # Steps along the square root of the light, as in the light image.
    saturated_root = (exposure.saturation / exposure.light) ** 0.5
    grey, noise = exposure.response_table
    response = np.stack((grey, (noise_factor * noise).astype(np.float32)), axis=1)
    fixed = pattern or _NO_PATTERN
    rows, channels = light.shape[0], light.shape[2]
    level_sum = expose_light(
        light.reshape(rows, -1), channels, (RESPONSE_STEPS - 1) / (saturated_root * LIGHT_WHITE), response,
        fixed.offset, fixed.gain, OFFSET_UNIT * exposure.amplification, 0.5 * GAIN_UNIT,
        _NOISE_QUANTILES, np.uint64(key), image.reshape(rows, -1),
    )  # fmt: skip
    return SensorImage(image if channels == 3 else image[:, :, 0], level_sum / (255.0 * image.size))
