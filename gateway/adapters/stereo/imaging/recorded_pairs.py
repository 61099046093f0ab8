"""Recorded stereo pairs in place of the scene: decoding, and the image source that the frame scheduler uses."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.device.stream_settings import StreamSettings
from gateway.adapters.stereo.imaging.rendered_images import COLOR, ImageRequest, Imaging, MeteredExposure
from gateway.adapters.stereo.imaging.scene_view import Capture
from renderers.drawlist import ImageError
from renderers.images import decode_image
from renderers.interface import Frame, Output, Renderer
from renderers.stereo.model import StereoModel
from renderers.stereo.sensor.camera_image import SensorImage
from scenegate.regular_files import read_regular

_TEST_MODEL_NAME: Final = "rc_test"
"""Model name of the device in its test mode."""
MAX_FOCAL_FACTOR: Final = 20.0
"""A smaller focal length is a factor of the image's width, as the vendor's test mode takes it; others are pixels."""
_CACHED_IMAGES: Final = 8
"""Number of decoded images in the cache: two pairs, each with Out1 low and high."""

ImageFile = Path | bytes
"""Path or content of an image file."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Encoded images (PNG, JPEG, WebP) of both cameras, rectified."""

    low: tuple[ImageFile, ImageFile]
    """Left and right with Out1 low."""
    high: tuple[ImageFile, ImageFile] | None = None
    """Left and right with Out1 high; None: as with Out1 low."""


class PairSequence:
    """Endless sequence of stereo pairs. Thread-safe."""

    def __init__(self, pairs: list[Pair], max_pixels: int) -> None:
        """
        Args:
            pairs: at least one; repeated from the start after the last.
            max_pixels: maximum number of pixels of one image.
        """
        self.size: tuple[int, int] | None = None
        """Width and height of every image; None before the first was decoded."""
        self._pairs = pairs
        self._max_pixels = max_pixels
        self._lock = threading.Lock()
        # An lru_cache on the method would keep every PairSequence alive.
        self._decode: Callable[[int, bool, bool], NDArray[np.uint8]] = lru_cache(_CACHED_IMAGES)(self._decode_uncached)

    def __len__(self) -> int:
        return len(self._pairs)

    def image(self, index: int, *, high: bool, right: bool) -> NDArray[np.uint8]:
        """Return (H, W, 3) uint8 RGB.

        Raises:
            ImageError: the image is unreadable, undecodable, or of another size than the first.
        """
        position = index % len(self._pairs)
        has_high = self._pairs[position].high is not None
        return self._decode(position, high and has_high, right)

    def _decode_uncached(self, position: int, high: bool, right: bool) -> NDArray[np.uint8]:
        pair = self._pairs[position]
        left_and_right = pair.high if high else pair.low
        assert left_and_right is not None
        source = left_and_right[1 if right else 0]
        name = f"the {'right' if right else 'left'} image of pair {position + 1}"
        if isinstance(source, Path):
            name = str(source)
            try:
                source = read_regular(source)
            except OSError as error:
                raise ImageError(f"{name}: {error.strerror}") from error
        image = np.ascontiguousarray(decode_image(source, name=name, max_pixels=self._max_pixels)[:, :, :3])
        height, width = image.shape[:2]
        with self._lock:  # two threads may decode the first images; the size never changes afterwards
            self.size = self.size or (width, height)
        if (width, height) != self.size:
            raise ImageError(f"{name} has {width}x{height} pixels, the first one {self.size[0]}x{self.size[1]}")
        return image


@dataclass(frozen=True, eq=False, kw_only=True)
class PairImaging(Imaging):
    """Source of recorded images. Depth is matched.

    Exposure, noise and the projector's light are as recorded: the settings do not change them. Of the methods that
    ``stream.frame`` calls, ``measure`` is inherited: it reads only images that were made. The colour camera, which
    renders by another method, does not exist for recorded pairs.
    """

    pairs: PairSequence

    def render(self, capture: Capture, offset: float, divisor: int, outputs: Output) -> Frame:
        """Refuse to render: there is no scene.

        Raises:
            LookupError: always.
        """
        raise LookupError("the camera shows recorded images; there is no ground truth")

    def meter(self, capture: Capture, settings: StreamSettings) -> MeteredExposure:
        left = self.pairs.image(capture.frame_number, high=capture.out1_high, right=False)
        return MeteredExposure(settings.manual_exposure, float(_grey(left).mean()) / 255.0)

    def expose(self, capture: Capture, request: ImageRequest) -> dict[bool, SensorImage]:
        rgb = self.pairs.image(capture.frame_number, high=capture.out1_high, right=request.stream.is_right)
        images = {}
        for color in request.colors:
            image = rgb if color == COLOR else _grey(rgb)
            images[color] = SensorImage(image, float(image.mean()) / 255.0)
        return images


def _grey(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)


@dataclass(frozen=True, slots=True)
class RecordedPairs:
    """Pairs and the geometry of the camera that recorded them."""

    sequence: PairSequence
    focal: float
    """Focal length; see ``MAX_FOCAL_FACTOR``."""
    baseline: float
    """Metres."""


def pair_imaging(config: StereoConfig, renderer: Renderer, recorded: RecordedPairs) -> PairImaging:
    """Return a source of recorded pairs. Decodes the first pair.

    Args:
        config: applies, but for the camera model and the depth mode.

    Raises:
        ImageError: an image of the first pair cannot be decoded.
        ValueError: size, focal length or baseline are beyond the limits of a stereo camera.
    """
    pairs, focal = recorded.sequence, recorded.focal
    left = pairs.image(0, high=False, right=False)
    for high, right in ((False, True), (True, False), (True, True)):
        pairs.image(0, high=high, right=right)  # raises ImageError if the image is broken
    height, width = left.shape[:2]
    focal_factor = focal if focal < MAX_FOCAL_FACTOR else focal / width
    model = StereoModel(_TEST_MODEL_NAME, width, height, focal_factor, recorded.baseline)
    config = replace(config, model=model, color_camera=None, depth_mode="matched")
    return PairImaging(config=config, renderer=renderer, pairs=pairs)
