"""Read the images of geometries: encoded files (base64 in JSON, bytes in MessagePack) and uint8 arrays.

Every image becomes an encoded file: an array becomes a PNG file. Equal files share one ``Image``, which is decoded once
to check that it can be drawn.
"""

import binascii
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import pybase64
from numpy.typing import NDArray

from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.number_arrays import ArrayError, PackedArray
from renderers.cache import WeakCache
from renderers.drawlist import Image, ImageError
from renderers.encode import png_rgba
from renderers.images import image_from_bytes
from scenegate.messages.field_kinds import CommandError, show

_RGBA_CONVERSIONS: Final = {1: cv2.COLOR_GRAY2RGBA, 3: cv2.COLOR_RGB2RGBA}
"""OpenCV's conversion to RGBA, by number of channels."""
_MAX_CACHED_IMAGES: Final = 10_000
_PROPERTIES_BYTES: Final = 256
"""Approximate size of an entry of the cache of images' properties."""


@dataclass(frozen=True, slots=True)
class CheckedImage:
    """An image that can be decoded."""

    image: Image
    width: int
    """Columns."""
    height: int
    """Rows."""
    has_alpha: bool
    """True if a pixel is not opaque."""


_cached_properties: Final[WeakCache[Image, tuple[int, int, bool]]] = WeakCache("image_properties", _MAX_CACHED_IMAGES)
"""Width, height and ``has_alpha`` of decoded images."""


def read_image(value: Any, name: str, limits: Limits) -> CheckedImage:
    """Return the image in the field ``name``. Raises CommandError if it cannot be decoded, or exceeds a limit."""
    try:
        if isinstance(value, PackedArray):
            data = png_rgba(_rgba(value.pixels(limits.image_pixels)))
        else:
            data = file_content(value, name, "a PNG or JPEG file (base64 in JSON) or a uint8 array")
        if len(data) > limits.image_bytes:
            raise CommandError(f"{name} has {len(data)} bytes, the limit is {limits.image_bytes}")
        return check_image(data, limits.image_pixels)
    except ArrayError as error:
        raise CommandError(f"{name} {error}") from None
    except ImageError as error:
        raise CommandError(f"{name} cannot be decoded: {error}") from None


def check_image(data: bytes, max_pixels: int) -> CheckedImage:
    """Return the image in an encoded file, which the first call decodes. Raises ImageError if it cannot."""
    image = image_from_bytes(data, max_pixels=max_pixels)
    properties = _cached_properties.get(image)
    if properties is None:
        pixels = image.decode()
        properties = pixels.shape[1], pixels.shape[0], pixels.shape[2] == 4 and bool((pixels[:, :, 3] < 255).any())
        _cached_properties.put(image, properties, _PROPERTIES_BYTES)
    return CheckedImage(image, *properties)


def drawn_image(pixels: NDArray[np.uint8]) -> CheckedImage:
    """Return an image of pixels, (H, W, 4) RGBA, that this process has drawn."""
    height, width = pixels.shape[:2]
    image = image_from_bytes(png_rgba(pixels))
    return CheckedImage(image, width, height, bool((pixels[:, :, 3] < 255).any()))


def file_content(value: Any, name: str, expected: str = "the content of a file (base64 in JSON)") -> bytes:
    """Return the content of a file: bytes in MessagePack, base64 in JSON; ``expected`` is for an error text."""
    if isinstance(value, bytes):
        return value
    if not isinstance(value, str):
        raise CommandError(f"{name} must be {expected}, not {show(value)}")
    try:
        return pybase64.b64decode(value, validate=True)
    except (binascii.Error, ValueError) as error:
        raise CommandError(f"{name} is not base64: {error}") from None


def _rgba(pixels: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return grey, RGB or RGBA pixels, (H, W) or (H, W, C) with C = 1, 3 or 4, as RGBA, (H, W, 4)."""
    channels = 1 if pixels.ndim == 2 else pixels.shape[2]
    conversion = _RGBA_CONVERSIONS.get(channels)
    contiguous = np.ascontiguousarray(pixels)
    return contiguous if conversion is None else np.asarray(cv2.cvtColor(contiguous, conversion), np.uint8)
