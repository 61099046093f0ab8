"""Camera image of a rendered image: light on the sensor, then the sensor's response with noise.

``light_on_sensor`` adds the projector, key light, lens blur and vignetting. Light is linear; 1 is rendered white
(``exposure.LIGHT_OF_LEVEL``). ``image_from_light`` makes the camera image of it, with noise and the fixed pattern of
the sensor: offsets of pixels and columns and gains of pixels, the same in every frame.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.cache import Cache
from renderers.compiler.kernel_types import u64
from renderers.stereo.light.projector import FULL_LIGHT
from renderers.stereo.model import Intrinsics
from renderers.stereo.sensor.exposure import LIGHT_OF_LEVEL, LIGHT_WHITE, LUMA, RESPONSE_STEPS, Exposure
from renderers.stereo.sensor.light_kernels import light_rows
from renderers.stereo.sensor.noise import NORMAL_TABLE
from renderers.stereo.sensor.sensor_kernels import expose_light

LENS_BLUR: Final = 0.7
"""Standard deviation of the point spread at full resolution, pixels. Our choice: a pixel's area alone has 0.29, the
diffraction of an f/2.8 lens on pixels of 3.75 um 0.3, and rectification adds an interpolation; 0.7 leaves 2 % of the
contrast at the pixels' Nyquist frequency."""
MAX_LENS_BLUR: Final = 0.70710678
"""Maximum standard deviation of the filter of three taps, pixels: a wider one would invert the finest patterns."""
VIGNETTING_EXPONENT: Final = 3
"""Power of the cosine of the field angle with which light falls. A thin lens has 4; real lenses correct a part."""
PIXEL_OFFSET: Final = 0.1
"""Standard deviation of the pixels' offsets at 0 dB, grey levels. Offsets are amplified by the gain.

The device's magnitudes are not published. Ours are of the order that data sheets (EMVA 1288) give for CMOS sensors with
global shutter, after the camera's own correction."""
COLUMN_OFFSET: Final = 0.08
"""Standard deviation of the columns' offsets at 0 dB, grey levels."""
PIXEL_GAIN: Final = 0.004
"""Standard deviation of the pixels' gains, relative (PRNU)."""
OFFSET_UNIT: Final = 1.0 / 128.0
"""Grey levels at 0 dB per unit of ``FixedPattern.offset``."""
GAIN_UNIT: Final = 1.0 / 4096.0
"""Relative light per unit of ``FixedPattern.gain``."""


ROOT_STEPS: Final = np.array((2047.0, 2047.0, 1023.0))
"""White in ``Frame.roots``, red, green, blue."""
_NO_DOTS: Final = np.zeros((1, 1), np.uint16)
"""Kernel argument for ``SceneLight.dots`` of None."""
_NO_FACTORS: Final = np.ones((1, 1), np.float32)
"""Kernel argument for ``SceneLight.factors`` of None."""
_GROUP_MEANS: Final = NORMAL_TABLE.reshape(128, -1).mean(axis=1)
"""(128,) float32, means of groups of neighbouring quantiles."""
_NOISE_QUANTILES: Final = np.asarray(_GROUP_MEANS / _GROUP_MEANS.std(), np.float32)
"""(128,) float32, quantiles of the standard normal distribution, coarser than ``NORMAL_TABLE``."""
_MASK64: Final = (1 << 64) - 1


@dataclass(frozen=True, slots=True)
class Lens:
    """Optical properties of both cameras' lenses."""

    blur: float = 0.0
    """Standard deviation of the point spread, pixels, 0 to ``MAX_LENS_BLUR``."""
    vignetting: bool = False
    """Light falls towards the corners (``VIGNETTING_EXPONENT``)."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneLight:
    """Light on the scene besides the rendered one."""

    dots: NDArray[np.uint16] | None = None
    """(H, W) uint16 light of the projector (``projector.projected_dots``); None: the projector is off."""
    dot_light: float = 0.0
    """Light that a full dot adds, relative to the rendered light."""
    factors: NDArray[np.float32] | None = None
    """(H, W or more) float32 factors of the rendered light, such as ``Frame.key_factor``; None: 1."""


def roots_of(image: NDArray[np.uint8]) -> NDArray[np.uint32]:
    """Return a rendered image in bytes, (H, W, 3), as ``Frame.roots``, (H, W) uint32."""
    roots = np.rint(LIGHT_OF_LEVEL[:, None] ** 0.5 * ROOT_STEPS).astype(np.uint32) << np.array((0, 11, 22), np.uint32)
    return np.asarray(roots[image[:, :, 0], 0] | roots[image[:, :, 1], 1] | roots[image[:, :, 2], 2])


def light_on_sensor(
    roots: NDArray[np.uint32],
    k: Intrinsics,
    exposure: Exposure,
    scene_light: SceneLight = SceneLight(),
    lens: Lens = Lens(),
    *,
    color: bool,
) -> NDArray[np.uint16]:
    """Return the square root of the light on each pixel of the sensor, (H, W, 3 or 1) uint16.

    White is ``LIGHT_WHITE``, and the largest value has 16 times the light of white. The square root gives dark parts
    finer steps of light than bright ones.

    Args:
        roots: (H, W or more), C-contiguous: the rendered image as ``Frame.roots``; see ``roots_of``.
        k: intrinsics of the image, for its width and the field angle.
        exposure: its white balance is applied; exposure time and gain are not.
        color: return RGB; otherwise grey, by the weights of Rec. 601.
    """
    dots = _NO_DOTS if scene_light.dots is None else scene_light.dots
    factors = _NO_FACTORS if scene_light.factors is None else scene_light.factors
    # The filter [w, 1 - 2 w, w] has the variance 2 w.
    neighbour_weight = 0.5 * min(lens.blur, MAX_LENS_BLUR) ** 2
    white_balance = exposure.channel_factors
    weights = np.diag(white_balance) if color else (LUMA * white_balance)[None]
    light = np.empty((len(roots), k.width, len(weights)), np.uint16)
    inv_focal = 1.0 / k.focal_length if lens.vignetting else 0.0
    light_rows(
        roots, dots, scene_light.dot_light / FULL_LIGHT, factors, (weights / ROOT_STEPS**2).astype(np.float32),
        neighbour_weight, k.cx, k.cy, inv_focal, light,
    )  # fmt: skip
    return light


def relative_light(light: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return the light of a light image, float32 of its shape; 1 is white."""
    root = light.astype(np.float32) / np.float32(LIGHT_WHITE)
    return root * root


class NoiseStream(IntEnum):
    """Independent random sequences of one frame, named by the image that uses them.

    ``*_DEPTH`` are the images for stereo matching, ``*_SECOND`` those without the projector's light (``double_shot``).
    """

    LEFT = 1
    RIGHT = 2
    LEFT_DEPTH = 3
    RIGHT_DEPTH = 4
    LEFT_SECOND = 6
    RIGHT_SECOND = 7
    COLOR_CAMERA = 10

    @property
    def is_right(self) -> bool:
        """True for images of the right camera."""
        return self in (NoiseStream.RIGHT, NoiseStream.RIGHT_DEPTH, NoiseStream.RIGHT_SECOND)


def frame_key(seed: int, frame: int, stream: NoiseStream) -> np.uint64:
    """Return the 64-bit random key of one stream of one frame (splitmix64 over the three numbers)."""
    state = 0
    for value in (seed, frame, int(stream)):
        state = (state ^ (value & _MASK64)) + 0x9E3779B97F4A7C15 & _MASK64
        state = (state ^ state >> 30) * 0xBF58476D1CE4E5B9 & _MASK64
        state = (state ^ state >> 27) * 0x94D049BB133111EB & _MASK64
        state ^= state >> 31
    return np.uint64(state)


@dataclass(frozen=True, slots=True, eq=False)
class FixedPattern:
    """Fixed pattern of one sensor."""

    offset: NDArray[np.int8]
    """(H, W) int8, units of ``OFFSET_UNIT``."""
    gain: NDArray[np.int8]
    """(H, W) int8, units of ``GAIN_UNIT``; 0: the mean gain."""


_NO_PATTERN: Final = FixedPattern(np.zeros((1, 1), np.int8), np.zeros((1, 1), np.int8))
_cached_patterns: Cache[tuple[int, bool, int, int], FixedPattern] = Cache("fixed_patterns")


def fixed_pattern(seed: int, *, right: bool, height: int, width: int) -> FixedPattern:
    """Return the pattern of the left or right sensor, from the cache if possible. It depends on the arguments only."""
    key = (seed, right, height, width)
    pattern = _cached_patterns.get(key)
    if pattern is None:
        pattern = _make_pattern(*key)
        _cached_patterns.put(key, pattern, pattern.offset.nbytes + pattern.gain.nbytes)
    return pattern


def _make_pattern(seed: int, right: bool, height: int, width: int) -> FixedPattern:
    random = np.random.Generator(np.random.Philox(key=(seed << 1 | int(right)) & (2**128 - 1)))

    def normal(*shape: int) -> NDArray[np.float64]:
        """Return approximately normal numbers from sums of four bytes: equal on every CPU, unlike a logarithm."""
        total = random.integers(0, 256, (4, *shape), np.uint8).sum(axis=0, dtype=np.int64)
        # The sum has the mean 4 * 127.5 and the standard deviation sqrt(4 * (256**2 - 1) / 12).
        numbers: NDArray[np.float64] = (total - 510.0) / 147.8
        return numbers

    def to_int8(values: NDArray[np.float64]) -> NDArray[np.int8]:
        return np.clip(np.rint(values), -127, 127).astype(np.int8)

    offset = PIXEL_OFFSET * normal(height, width) + COLUMN_OFFSET * normal(width)
    return FixedPattern(to_int8(offset / OFFSET_UNIT), to_int8(PIXEL_GAIN / GAIN_UNIT * normal(height, width)))


def fixed_pattern_variance(exposure: Exposure) -> NDArray[np.float64]:
    """Return the variance of the fixed pattern at each grey level, (256,) float64, squared grey levels."""
    offset = (PIXEL_OFFSET**2 + COLUMN_OFFSET**2) * exposure.amplification**2
    return offset + (np.arange(256.0) * exposure.gamma * PIXEL_GAIN) ** 2


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
        light: (H, W, 3 or 1), ``light_on_sensor`` with the white balance of ``exposure``.
        key: random key of this frame and camera (``frame_key``).
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
        _NOISE_QUANTILES, u64(key), image.reshape(rows, -1),
    )  # fmt: skip
    return SensorImage(image if channels == 3 else image[:, :, 0], level_sum / (255.0 * image.size))
