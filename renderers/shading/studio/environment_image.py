"""Environments as equirectangular images of radiance: read from Radiance files, or painted from a rig's softboxes."""

import math
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from renderers.light_rig import Hemisphere, Softbox, Surroundings
from renderers.shading.studio.octahedral import equirect_directions

MAX_HDR_PIXELS: Final = 8192 * 4096
"""Maximum number of pixels of a Radiance image: 400 MB as float32."""
_MAX_RADIANCE: Final = 65504.0
"""Larger values of a Radiance image are reduced to this, the largest float16."""
_MAX_SCALED_RADIANCE: Final = 1e12
"""Maximum radiance times intensity: its products with exposure and colours fit into float32. The sun has 1e9."""
_PAINTED_SIZE: Final = (256, 512)
"""Height and width of images painted from a rig, pixels."""


class SurroundingsError(ValueError):
    """A Radiance image cannot be used. The message says why."""


def radiance_of(surroundings: Surroundings) -> NDArray[np.float32]:
    """Return an environment as an equirectangular image, (H, W, 3) float32, before the rotation by ``turn``.

    Raises:
        SurroundingsError: see ``read_hdr``.
    """
    if surroundings.image is not None:
        return _scaled(read_hdr(surroundings.image), surroundings.intensity)
    directions = equirect_directions(*_PAINTED_SIZE)
    radiance = _hemisphere_radiance(surroundings.hemisphere, directions)
    for box in surroundings.softboxes:
        radiance = radiance + _softbox_coverage(box, directions)[..., None] * np.array(box.radiance)
    return _scaled(radiance, surroundings.intensity)


def _scaled(radiance: NDArray[Any], intensity: float) -> NDArray[np.float32]:
    """Return the radiance times the intensity, at most ``_MAX_SCALED_RADIANCE``."""
    limited = np.minimum(radiance, _MAX_SCALED_RADIANCE / max(intensity, 1.0))
    scaled: NDArray[np.float32] = (limited * intensity).astype(np.float32)
    return scaled


def _hemisphere_radiance(hemisphere: Hemisphere, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the radiance of a hemisphere in each direction, (H, W, 3) float64. ``directions``: (H, W, 3), unit."""
    sky, ground = np.array(hemisphere.sky), np.array(hemisphere.ground)
    radiance: NDArray[np.float64] = ground + (0.5 + 0.5 * directions[..., 2:]) * (sky - ground)
    return radiance


def _softbox_coverage(box: Softbox, directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the share of a softbox's radiance in each direction, (H, W) float64: 1 inside, fading at the edges."""
    center = np.array(box.direction) / np.linalg.norm(box.direction)
    across = np.cross((0.0, 0.0, 1.0), center)
    across = across / np.linalg.norm(across) if np.linalg.norm(across) > 1e-9 else np.array((0.0, 1.0, 0.0))
    up = np.cross(center, across)
    cosine = directions @ center
    is_ahead = cosine > 0.0
    depth = np.where(is_ahead, cosine, 1.0)
    coverage: NDArray[np.float64] = is_ahead.astype(np.float64)
    for axis, half_angle in ((across, box.half_width), (up, box.half_height)):
        distance = np.abs(directions @ axis) / depth / math.tan(half_angle)  # from the centre; 1 at the edge
        t = np.clip((1.0 - distance) / box.softness + 0.5, 0.0, 1.0)
        coverage = coverage * t * t * (3.0 - 2.0 * t)
    return coverage


def read_hdr(data: bytes) -> NDArray[np.float32]:
    """Decode a Radiance image to (H, W, 3) float32 linear RGB.

    Raises:
        SurroundingsError: not a Radiance image, too large, or not equirectangular (twice as wide as high).
    """
    if not data.startswith(b"#?"):
        raise SurroundingsError("the surroundings are no Radiance image (.hdr), which begins with '#?'")
    size_line = next((line.split() for line in data[:4096].split(b"\n") if line.startswith((b"-Y", b"+Y"))), [])
    try:
        height, width = int(size_line[1]), int(size_line[3])
    except (IndexError, ValueError):
        raise SurroundingsError("the Radiance image has no line with its size") from None
    if not 0 < height * width <= MAX_HDR_PIXELS or width != 2 * height:
        raise SurroundingsError(
            f"the Radiance image has {width}x{height} pixels; it must be twice as wide as high and have at most "
            f"{MAX_HDR_PIXELS}"
        )
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        pixels = None
    if pixels is None or pixels.dtype != np.float32 or pixels.shape != (height, width, 3):
        raise SurroundingsError("the Radiance image is broken")
    rgb = np.ascontiguousarray(pixels[..., ::-1])
    return np.clip(np.nan_to_num(rgb, nan=0.0, posinf=_MAX_RADIANCE), 0.0, _MAX_RADIANCE).astype(np.float32)
