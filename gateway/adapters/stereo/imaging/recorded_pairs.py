"""Recorded stereo pairs in place of the scene: a folder of images, their geometry, and the image source of frames."""

import re
from collections.abc import Callable, Sequence
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
from scenegate.regular_files import open_regular, read_regular

_TEST_MODEL_NAME: Final = "rc_test"
"""Model name of the device in its test mode."""
_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".webp")
_CACHED_IMAGES: Final = 8
"""Number of decoded images in the cache: four pairs."""


def find_pairs(folder: Path, max_pairs: int) -> list[tuple[Path, Path]]:
    """Return the left and right images of all pairs below a folder, in the order of their names.

    The right image of ``…left….png`` is ``…right….png``, in file or folder names: the last ``left`` becomes ``right``.
    Raises ValueError, one sentence, if there are no pairs, or more than ``max_pairs``.
    """
    if not folder.is_dir():
        raise ValueError(f"{folder} is not a folder")
    images = sorted(path for path in folder.rglob("*") if path.suffix.lower() in _SUFFIXES and path.is_file())
    if not images:
        raise ValueError(f"{folder} holds no images ({', '.join(_SUFFIXES)})")
    existing = set(images)
    pairs = []
    for left in images:
        before, name, after = str(left.relative_to(folder)).rpartition("left")
        right = folder / f"{before}right{after}"
        if name and right in existing:
            pairs.append((left, right))
    if not pairs:
        raise ValueError(f"{folder} holds no stereo pairs: none of its {len(images)} images is a …left… with a …right…")
    if len(pairs) > max_pairs:
        raise ValueError(f"{folder} holds {len(pairs)} stereo pairs, more than {max_pairs}")
    return pairs


def read_geometry(folder: Path) -> tuple[float, float] | None:
    """Return the focal length divided by the image width, and the baseline in metres, from files below a folder.

    The files are ``*.npz`` of ``scenegate stream``, or ``*param.txt`` of the vendor's tools (``camera.A``,
    ``camera.width``, ``t``). The vendor's files describe the disparity image, whose width in quality Low is rounded.
    None: there are no such files. Raises ValueError, one sentence, if a file cannot be read.
    """
    for path in sorted(folder.rglob("*.npz")):
        try:
            with open_regular(path) as file, np.load(file, allow_pickle=False) as arrays:
                if {"left", "left_K", "baseline"} <= set(arrays.files):
                    return float(arrays["left_K"][0, 0]) / arrays["left"].shape[1], float(arrays["baseline"])
        except (OSError, ValueError, IndexError) as error:
            raise ValueError(f"{path} cannot be read: {error}") from None
    for path in sorted(folder.rglob("*param.txt")):
        with open_regular(path) as file:
            text = file.read(10_000).decode("utf-8", "replace")
        focal, width, baseline = (
            re.search(pattern, text, re.MULTILINE)
            for pattern in (r"^camera\.A=\[\s*([\d.eE+-]+)", r"^camera\.width=(\d+)", r"^t=([\d.eE+-]+)")
        )
        if focal and width and baseline:
            try:
                return float(focal[1]) / int(width[1]), float(baseline[1])
            except (ValueError, ZeroDivisionError):
                raise ValueError(f"{path}: camera.A, camera.width or t is not a number") from None
    return None


class RecordedPairs:
    """Endless sequence of rectified stereo pairs, from one camera. Thread-safe."""

    def __init__(
        self, pairs: Sequence[tuple[Path, Path]], focal_factor: float, baseline: float, max_pixels: int
    ) -> None:
        """Decode the first of the left and right images, which are repeated from the start after the last.

        The focal length is ``focal_factor`` times the width of the images, the baseline in metres. Raises ImageError if
        an image of the first pair cannot be decoded, ValueError if its geometry is beyond the limits of a stereo
        camera.
        """
        self._pairs = pairs
        self._max_pixels = max_pixels
        self._size = (0, 0)
        # An lru_cache on the method would keep every object alive.
        self._decode: Callable[[int, bool], NDArray[np.uint8]] = lru_cache(_CACHED_IMAGES)(self._decode_uncached)
        height, width = self.image(0, right=False).shape[:2]
        self._size = width, height
        self.image(0, right=True)
        self.model = StereoModel(_TEST_MODEL_NAME, width, height, focal_factor, baseline)

    def image(self, index: int, *, right: bool) -> NDArray[np.uint8]:
        """Return (H, W, 3) uint8 RGB. Raises ImageError if it is unreadable, undecodable, or of another size than the
        first."""
        return self._decode(index % len(self._pairs), right)

    def _decode_uncached(self, position: int, right: bool) -> NDArray[np.uint8]:
        path = self._pairs[position][right]
        try:
            data = read_regular(path)
        except OSError as error:
            raise ImageError(f"{path}: {error.strerror}") from error
        image = np.ascontiguousarray(decode_image(data, name=str(path), max_pixels=self._max_pixels)[:, :, :3])
        height, width = image.shape[:2]
        if (width, height) != self._size != (0, 0):
            raise ImageError(f"{path} has {width}x{height} pixels, the first one {self._size[0]}x{self._size[1]}")
        return image


@dataclass(frozen=True, eq=False, kw_only=True)
class PairImaging(Imaging):
    """Source of recorded images. Depth is matched.

    Exposure, noise and the projector's light are as recorded: the settings do not change them. Of the methods that
    ``stream.frame`` calls, ``measure`` is inherited: it reads only images that were made. The colour camera, which
    renders by another method, does not exist for recorded pairs.
    """

    pairs: RecordedPairs

    def render(self, capture: Capture, offset: float, divisor: int, outputs: Output) -> Frame:
        """Raise LookupError: there is no scene."""
        raise LookupError("the camera shows recorded images; there is no ground truth")

    def meter(self, capture: Capture, settings: StreamSettings) -> MeteredExposure:
        left = self.pairs.image(capture.frame_number, right=False)
        return MeteredExposure(settings.manual_exposure, float(_grey(left).mean()) / 255.0)

    def expose(self, capture: Capture, request: ImageRequest) -> dict[bool, SensorImage]:
        rgb = self.pairs.image(capture.frame_number, right=request.stream.is_right)
        images = {}
        for color in request.colors:
            image = rgb if color == COLOR else _grey(rgb)
            images[color] = SensorImage(image, float(image.mean()) / 255.0)
        return images


def _grey(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)


def pair_imaging(config: StereoConfig, renderer: Renderer, pairs: RecordedPairs) -> PairImaging:
    """Return a source of recorded pairs. ``config`` applies, but for the camera model and the depth mode."""
    config = replace(config, model=pairs.model, color_camera=None, depth_mode="matched")
    return PairImaging(config=config, renderer=renderer, pairs=pairs)
